// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { RunAlarm } from '../../src/api/alarms';
import type { Service } from '../../src/api/types';
import { raisedAlarms, ruleOf, type RuleForm } from '../../src/maths/alarms';

const FORM: RuleForm = { when: 'below', runs: ' ', figure: ' spl ', value: '0,5', points: '3', minutes: '' };

describe('a rule', () => {
  it('has what its form needs, and nothing else', () => {
    expect(ruleOf(FORM)).toEqual({ when: 'below', runs: '*', figure: 'spl', value: 0.5, points: 3 });
    expect(ruleOf({ ...FORM, when: 'not_finite', runs: 'demo/*' })).toEqual({ when: 'not_finite', runs: 'demo/*', figure: 'spl', points: 3 });
    expect(ruleOf({ ...FORM, when: 'silent', figure: '', minutes: '30' })).toEqual({ when: 'silent', runs: '*', minutes: 30 });
    expect(ruleOf({ ...FORM, when: 'lost' })).toEqual({ when: 'lost', runs: '*' });
  });

  it('is not made of a form that lacks something', () => {
    expect(() => ruleOf({ ...FORM, figure: '' })).toThrow('Name the figure.');
    expect(() => ruleOf({ ...FORM, value: '' })).toThrow('The value must be a number.');
    expect(() => ruleOf({ ...FORM, points: 'many' })).toThrow('points must be a number');
    expect(() => ruleOf({ ...FORM, when: 'silent' })).toThrow('minutes must be a number');
  });
});

describe('alarms that last', () => {
  it('are those of services and of runs', () => {
    const service = (id: string, alarm: string): Service => ({ id, session: 'demo', alarm }) as Service;
    const alarm = (id: number, over: number | null): RunAlarm => ({ id, rule: 1, run: `p/${id}`, since: id, over, text: 'loss above 5' });
    expect(raisedAlarms([service('a', ''), service('b', 'disk full')], [alarm(3, null), alarm(2, 9), alarm(1, null)])).toEqual([
      { key: 'demo/b', service: 'b', text: 'disk full', since: null },
      { key: 'alarm 3', run: 'p/3', text: 'loss above 5', since: 3, id: 3 },
      { key: 'alarm 1', run: 'p/1', text: 'loss above 5', since: 1, id: 1 },
    ]);
    expect(raisedAlarms([], [])).toEqual([]);
  });
});
