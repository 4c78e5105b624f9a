// SPDX-License-Identifier: Apache-2.0
import type { NewRule, RunAlarm, When } from '../api/alarms';
import type { Service } from '../api/types';

/** An alarm that lasts, of a service or of a run. */
export interface Raised {
  key: string;
  service?: string;
  run?: string;
  text: string;
  since: number | null;
  /** ID of a run's alarm. */
  id?: number;
}

/** Returns the alarms that last: those of services, then those of runs, newest first. */
export function raisedAlarms(services: readonly Service[], alarms: readonly RunAlarm[]): Raised[] {
  return [
    ...services.filter((one) => one.alarm).map((one) => ({ key: `${one.session}/${one.id}`, service: one.id, text: one.alarm, since: null })),
    ...alarms.filter((one) => one.over === null).map((one) => ({ key: `alarm ${one.id}`, run: one.run, text: one.text, since: one.since, id: one.id })),
  ];
}

/** What people fill in. */
export interface RuleForm {
  when: When;
  runs: string;
  figure: string;
  value: string;
  points: string;
  minutes: string;
}

export const FIGURE_OF: Record<When, 'needed' | 'possible' | 'none'> = { below: 'needed', above: 'needed', not_finite: 'needed', silent: 'possible', lost: 'none' };

/** Returns the rule of a form. Throws an Error that says what is missing. */
export function ruleOf(form: RuleForm): NewRule {
  const rule: NewRule = { when: form.when, runs: form.runs.trim() || '*' };
  const number = (text: string, name: string): number => {
    const value = Number(text.trim().replace(',', '.'));
    if (text.trim() === '' || !Number.isFinite(value)) throw new Error(`${name} must be a number.`);
    return value;
  };
  const figure = form.figure.trim();
  if (FIGURE_OF[form.when] === 'needed' && !figure) throw new Error('Name the figure.');
  if (FIGURE_OF[form.when] !== 'none' && figure) rule.figure = figure;
  if (form.when === 'below' || form.when === 'above') rule.value = number(form.value, 'The value');
  if (FIGURE_OF[form.when] === 'needed') rule.points = number(form.points, 'The number of points');
  if (form.when === 'silent') rule.minutes = number(form.minutes, 'The number of minutes');
  return rule;
}
