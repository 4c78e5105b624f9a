// SPDX-License-Identifier: Apache-2.0
// Alarms, as docs/reference/dashboard-api.md has them.

export type When = 'below' | 'above' | 'not_finite' | 'silent' | 'lost';

/** What is sent to make a rule. */
export interface NewRule {
  runs: string;
  when: When;
  figure?: string;
  value?: number;
  points?: number;
  steps?: number;
  minutes?: number;
}

export interface AlarmRule {
  id: number;
  runs: string;
  when: When;
  figure: string | null;
  created: number;
  /** The rule in words, without its runs. */
  text: string;
}

export interface RunAlarm {
  id: number;
  rule: number;
  run: string;
  since: number;
  /** When it ended; null while it lasts. */
  over: number | null;
  text: string;
}

export interface AlarmsAnswer {
  rules: AlarmRule[];
  alarms: RunAlarm[];
}
