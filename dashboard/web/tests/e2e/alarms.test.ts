// SPDX-License-Identifier: Apache-2.0
import { join } from 'node:path';
import { describe, expect, it } from 'vitest';
import type { AlarmsAnswer } from '../../src/api/alarms';
import { startDashboard } from './programs';
import { api, eventually, Stage, violations, wider } from './stage';

const stage = Stage.ofProgram({ middleware: 'inprocess' });
const RUN = 'walks/night';
let received = 0;

/** Logs values of `loss` to a run, as any program may. */
async function log(...values: number[]): Promise<void> {
  const points = values.map((loss, i) => ({ step: received + i, time: Date.now() / 1000, values: { loss } }));
  const records = received ? points : [{ begin: { started: Date.now() / 1000, title: 'a run of the night' } }, ...points];
  const body = JSON.stringify({ source: 'python', log: RUN, first: received + 1, records });
  const answer = await fetch(`${stage.url}api/runs/${encodeURIComponent(RUN)}`, { method: 'POST', body });
  expect(answer.status, await answer.clone().text()).toBe(200);
  received = ((await answer.json()) as { received: number }).received;
}

describe('alarms of runs', () => {
  it('are raised by a rule that was made on the page, until they are over', async () => {
    await log(1, 2, 1);
    const { page, complaints } = await stage.page('overview');
    const card = page.locator('section[aria-label="Alarms"]');
    await card.getByText('No alarms').waitFor();
    await card.getByRole('button', { name: 'New rule' }).click();
    await card.getByRole('combobox', { name: 'Alarm when' }).selectOption('above');
    await card.getByRole('button', { name: 'Save' }).click();
    await card.getByRole('alert').getByText('Name the figure.').waitFor();
    await card.getByRole('combobox', { name: 'Figure' }).fill('lost');
    await card.getByRole('textbox', { name: 'Value' }).fill('5');
    await card.getByRole('textbox', { name: 'For so many points' }).fill('2');
    await card.getByRole('combobox', { name: /^Runs/ }).fill('walks/*');
    expect(await violations(page)).toEqual([]);
    complaints.length = 0; // the browser notes the answer 400
    await card.getByRole('button', { name: 'Save' }).click();
    await card.getByRole('alert').getByText("none of the runs 'walks/*' has a figure 'lost'").waitFor();
    complaints.length = 0;
    await card.getByRole('combobox', { name: 'Figure' }).fill('loss');
    await card.getByRole('combobox', { name: 'Figure' }).press('Enter');
    await card.getByRole('list', { name: 'Rules' }).getByText('loss above 5 for 2 points').waitFor();
    await log(9, 9);
    const lasting = card.getByRole('list', { name: 'Alarms that last' });
    await lasting.getByText('loss above 5 for 2 points: 9 at step').waitFor();
    await expect.poll(() => page.locator('.alarm-badge').textContent()).toBe('1 alarm');
    await page.locator('.run-card .tone-bad', { hasText: 'loss above 5' }).waitFor();
    await page.locator('.event-alarm', { hasText: 'loss above 5 for 2 points: 9' }).waitFor();
    const metrics = await (await fetch(`${stage.url}metrics`)).text();
    expect(metrics).toContain(`citylearn_run_alarm{run="${RUN}",rule="loss above 5 for 2 points",rule_id="1"} 1`);
    expect((await fetch(`${stage.url}healthz`)).status).toBe(200);
    expect(await violations(page)).toEqual([]);
    await log(1, 1);
    await lasting.waitFor({ state: 'detached' });
    await card.getByRole('list', { name: 'Alarms that are over' }).getByText('loss above 5').waitFor();
    await expect.poll(() => page.locator('.alarm-badge').count()).toBe(0);
    expect(complaints).toEqual([]);
  });

  it('are raised once, also when the dashboard is killed', async () => {
    await log(9, 9);
    const raised = async (): Promise<AlarmsAnswer['alarms']> => (await api<AlarmsAnswer>(stage.url, 'alarms')).alarms;
    await eventually(raised, (all) => all.length === 2 && all[0]?.over === null);
    await stage.dashboard.program.kill('SIGKILL');
    stage.dashboard = await startDashboard({ middleware: 'inprocess', store: join(stage.folder, 'dashboard.sqlite') }, stage.folder, { name: 'again' });
    stage.url = stage.dashboard.url;
    await log(9);
    // A rule that was made after shows that the points have been looked at.
    const rule = { when: 'above', figure: 'loss', value: 8 };
    expect((await fetch(`${stage.url}api/alarms`, { method: 'POST', body: JSON.stringify(rule) })).status).toBe(200);
    await eventually(raised, (all) => all.length === 3);
    expect((await raised()).filter((one) => one.rule === 1)).toHaveLength(2);
  });

  it('are dismissed, rules are removed, and all of it fits a telephone', async () => {
    const { page, complaints } = await stage.page('overview', { viewport: { width: 400, height: 800 } });
    const card = page.locator('section[aria-label="Alarms"]');
    const dismiss = card.getByRole('button', { name: /^Dismiss the alarm of walks\/night: loss above 8/ });
    await dismiss.waitFor();
    await card.getByRole('button', { name: 'New rule' }).click();
    expect(await wider(page)).toBeLessThanOrEqual(0);
    expect(await violations(page)).toEqual([]);
    await dismiss.click();
    await dismiss.waitFor({ state: 'detached' });
    for (const text of ['loss above 8', 'loss above 5']) {
      const remove = card.getByRole('button', { name: new RegExp(`^Remove the rule: ${text}`) });
      await remove.click();
      await remove.waitFor({ state: 'detached' });
    }
    expect(await api<AlarmsAnswer>(stage.url, 'alarms')).toEqual({ rules: [], alarms: [] });
    expect(complaints).toEqual([]);
  });
});
