// SPDX-License-Identifier: Apache-2.0
import { beforeAll, describe, expect, it } from 'vitest';
import { api, eventually, Stage, violations, wider } from './stage';

const stage = Stage.ofProgram({ middleware: 'inprocess' });
const MANY = 1000;

/** Logs records to a run, as any program may. */
async function post(id: string, first: number, records: object[]): Promise<number> {
  const body = JSON.stringify({ source: 'python', log: id, first, records });
  const answer = await fetch(`${stage.url}api/runs/${encodeURIComponent(id)}`, { method: 'POST', body });
  expect(answer.status, await answer.clone().text()).toBe(200);
  return ((await answer.json()) as { received: number }).received;
}

const point = (step: number, values: Record<string, number | null>): object => ({ step, time: 1_790_000_000 + step, values });
const curve = (rate: number): object[] => Array.from({ length: 200 }, (_, i) => point(10 * i, { loss: Math.exp(-rate * i), 'test/spl': i / 200 }));

beforeAll(async () => {
  for (const [name, rate] of [['slow', 0.01], ['fast', 0.05]] as const)
    await post(`walks/${name}`, 1, [
      { begin: { started: 1_790_000_000, title: `a ${name} one`, tags: [name] } },
      { config: { rate, net: { width: 64, kind: 'lstm' } } },
      ...curve(rate),
      { end: 1_790_002_000 },
    ]);
});

describe('logged runs', () => {
  it('are among the runs, with a chart for each metric', async () => {
    const { page, complaints } = await stage.page('training?runs=walks%2Fslow');
    const chart = page.getByRole('img', { name: /^loss/ });
    await chart.waitFor();
    await expect.poll(() => chart.getAttribute('aria-label')).toContain('a slow one · walks/slow');
    await page.getByRole('img', { name: /^test\/spl/ }).waitFor();
    expect(await page.getByRole('img', { name: /^SPL/ }).count()).toBe(0);
    await page.getByRole('checkbox', { name: /a fast one/ }).check();
    await eventually(() => chart.getAttribute('aria-label'), (label) => label?.includes('walks/fast') ?? false);
    expect(complaints).toEqual([]);
    expect(await violations(page)).toEqual([]);
  });

  it('are compared by what differs', async () => {
    const { page, complaints } = await stage.page(`compare?runs=${encodeURIComponent('walks/slow\nwalks/fast')}`);
    const options = page.locator('section[aria-label="Manifests"]');
    await options.getByText('rate', { exact: true }).waitFor();
    expect(await options.getByText('net.width').count()).toBe(0);
    const figures = page.locator('section[aria-label="Side by side"]');
    await figures.getByText('loss', { exact: true }).waitFor();
    expect(await figures.getByText('test/spl').count()).toBe(0);
    await figures.getByRole('radio', { name: 'All' }).check({ force: true });
    await figures.getByText('test/spl').waitFor();
    const chart = page.getByRole('img', { name: /^loss/ });
    await chart.waitFor();
    await page.getByRole('combobox', { name: 'Figure' }).selectOption('test/spl');
    await page.getByRole('img', { name: /^test\/spl/ }).waitFor();
    // The address is the view.
    await page.waitForFunction(() => location.hash.includes('metric=') && location.hash.includes('figures=all'));
    const { page: other } = await stage.page(new URL(page.url()).hash.slice(2));
    await other.getByRole('img', { name: /^test\/spl/ }).waitFor();
    await other.locator('section[aria-label="Side by side"]').getByText('test/spl').waitFor();
    expect(complaints).toEqual([]);
    expect(await violations(page)).toEqual([]);
  });

  it('fit a telephone', async () => {
    for (const hash of [`compare?runs=${encodeURIComponent('walks/slow\nwalks/fast')}`, 'training?runs=walks%2Fslow', 'overview']) {
      const { page } = await stage.page(hash, { viewport: { width: 400, height: 800 } });
      if (hash !== 'overview') await page.getByRole('img', { name: /^loss/ }).waitFor();
      expect(await wider(page), hash).toBeLessThanOrEqual(0);
      expect(await violations(page), hash).toEqual([]);
    }
  });

  it('appear and grow while a page is open', async () => {
    const { page } = await stage.page('training?smooth=0');
    let next = await post('walks/live', 1, [{ begin: { started: Date.now() / 1000, title: 'a live one' } }, point(0, { loss: 5 })]);
    const box = page.getByRole('checkbox', { name: /a live one/ });
    await box.waitFor();
    await box.check();
    const last = page.getByRole('img', { name: /^loss/ });
    await last.waitFor();
    next = await post('walks/live', next + 1, [point(1, { loss: 5 }), point(2, { loss: 7.125 })]);
    await post('walks/live', next + 1, []);
    await eventually(() => last.getAttribute('aria-label'), (label) => /live one[^;]*7\.1/.test(label ?? ''));
  });

  it('are soon there when there are a thousand of them', async () => {
    for (let i = 0; i < MANY; i += 20)
      await Promise.all(
        Array.from({ length: 20 }, (_, n) => post(`many/${i + n}`, 1, [{ begin: { started: 1_780_000_000 + i + n } }, { config: { seed: i + n } }, ...curve(0.02).slice(0, 20), { end: 0 }])),
      );
    const begin = Date.now();
    expect((await api<{ runs: unknown[] }>(stage.url, 'runs')).runs.length).toBeGreaterThanOrEqual(MANY);
    expect(Date.now() - begin).toBeLessThan(2000);
    const { page, complaints } = await stage.page(`compare?runs=${encodeURIComponent('many/3\nmany/4')}`);
    await page.getByRole('img', { name: /^loss/ }).waitFor();
    const listed = page.locator('section[aria-label="Runs"] tbody tr');
    expect(await listed.count()).toBeLessThan(200);
    await page.getByRole('searchbox', { name: 'Find runs' }).fill('many/77');
    await eventually(() => listed.count(), (count) => count === 11);
    await page.getByRole('searchbox', { name: 'Find runs' }).fill('');
    await page.getByRole('button', { name: /^Show all 1,?\d{3} runs$/ }).click();
    await eventually(() => listed.count(), (count) => count >= MANY);
    expect(complaints).toEqual([]);
  });
});
