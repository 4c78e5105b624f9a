// SPDX-License-Identifier: Apache-2.0
import { describe, expect, inject, it } from 'vitest';
import type { Page } from 'playwright-core';
import { startDashboard } from './programs';
import { eventually, Stage } from './stage';

/** Steps of the running run's card on the overview. */
const steps = (page: Page): Promise<string> => page.locator('.run-card .pairs dd').nth(2).innerText();

describe('live', () => {
  const stage = Stage.ofCity();

  it('the overview moves by itself', async () => {
    const { page } = await stage.page('overview');
    await page.waitForSelector('.run-card');
    const first = await steps(page);
    await eventually(() => steps(page), (now) => now !== first);
  });

  it('curves grow', async () => {
    const { page } = await stage.page('training?show=runs');
    const plot = page.getByRole('img', { name: /^Steps per second/ });
    await plot.scrollIntoViewIfNeeded();
    const first = await plot.getAttribute('aria-label');
    await eventually(() => plot.getAttribute('aria-label'), (now) => now !== first);
  });

  it('agents move, and what the chosen one sees comes as a picture', async () => {
    const { page } = await stage.page('route');
    await page.waitForSelector('.picture img');
    const caption = page.locator('.picture figcaption .number').first();
    const first = await caption.innerText();
    await eventually(() => caption.innerText(), (now) => now !== first);
    await expect.poll(() => page.locator('.picture img').first().evaluate((img: HTMLImageElement) => img.naturalWidth)).toBeGreaterThan(0);
    // The sibling shows the same place of its own traversal.
    await eventually(() => page.locator('.picture img').count(), (count) => count === 2);
  });

  it('pictures beside each other are of one frame', async () => {
    const { page } = await stage.page('route');
    const frames = (): Promise<string[]> =>
      page.evaluate(() => [...document.querySelectorAll<HTMLElement>('.picture figcaption .number')].map((one) => one.innerText));
    const seen = new Set<string>();
    await eventually(frames, (now) => {
      if (now.length === 2) expect(now[0]).toBe(now[1]);
      return now.length === 2 && seen.add(now[0] ?? '').size > 4;
    });
  });

  it('pictures are asked for only while they are seen', async () => {
    const { page } = await stage.page('overview');
    let watched: string[] = [];
    page.on('websocket', (socket) => socket.on('framesent', ({ payload }) => (watched = (JSON.parse(String(payload)) as { watch: string[] }).watch)));
    await page.goto(`${stage.url}#/route`);
    await page.reload();
    await page.waitForSelector('.picture img');
    const pictures = (): Promise<boolean> => Promise.resolve(watched.some((topic) => topic.startsWith('picture:')));
    await expect.poll(pictures).toBe(true);
    await page.goto(`${stage.url}#/compare`);
    await eventually(pictures, (now) => !now);
    expect(watched).toContain('services');
  });

  it('a lost service turns red and comes back', async () => {
    const { page, complaints } = await stage.page('overview');
    const row = page.getByRole('row', { name: /^encoder / });
    await row.locator('.state').waitFor();
    expect(await row.getAttribute('class') ?? '').not.toContain('bad');
    const { encoder } = inject('city');
    const lost = page.locator('.event-lost', { hasText: 'encoder' });
    const back = page.locator('.event-back', { hasText: 'encoder' });
    const before = await lost.count();
    // The badge counts what the rows say: on a busy machine another service may be late, and other specs stop theirs.
    const counted = (): Promise<[number, number]> =>
      page.evaluate(() => [parseInt(document.querySelector<HTMLElement>('.badge')?.innerText ?? '0'), document.querySelectorAll('tr .state-lost, tr .state-failed').length]);
    process.kill(encoder, 'SIGSTOP');
    try {
      await row.locator('.state-lost').waitFor();
      await expect.poll(() => row.getAttribute('class')).toContain('bad');
      await eventually(counted, ([badge, rows]) => badge > 0 && badge === rows);
      await eventually(() => lost.count(), (count) => count > before);
    } finally {
      process.kill(encoder, 'SIGCONT');
    }
    await row.locator('.state-lost').waitFor({ state: 'detached' });
    await eventually(counted, ([badge, rows]) => badge === rows);
    await eventually(() => back.count(), (count) => count > before);
    expect(complaints).toEqual([]);
  });
});

describe('a dashboard that is killed and started again', () => {
  const stage = Stage.ofProgram(() => ({ ...inject('city').wire, id: 'second', leave: true }));

  it('is missed, keeps what the page had, and is found again', async () => {
    const { page } = await stage.page('overview');
    await page.waitForSelector('.run-card');
    const { port } = new URL(stage.url);
    await stage.dashboard.program.kill('SIGKILL');
    await page.locator('.banner', { hasText: 'does not answer' }).waitFor();
    await expect.poll(() => page.locator('[data-link]').getAttribute('data-link')).not.toBe('open');
    expect(await page.locator('.run-card').count()).toBeGreaterThan(0);
    stage.dashboard = await startDashboard({ ...inject('city').wire, id: 'second', leave: true, port }, stage.folder);
    await page.locator('[data-link="open"]').waitFor();
    await page.locator('.banner').waitFor({ state: 'detached' });
    const first = await steps(page);
    await eventually(() => steps(page), (now) => now !== first);
  });
});

describe('what a service seldom says', () => {
  const stage = Stage.ofMock();

  it('an alarm stands in its service\'s row, in the overview and among the events until it is over', async () => {
    const { page } = await stage.page('overview');
    const row = page.locator('tr', { hasText: 'policy_service' });
    await row.locator('.state-running').waitFor();
    expect(await row.locator('.alarm').count()).toBe(0);
    stage.mock.alarm('policy', 'checkpoint: No space left on device');
    await row.locator('.alarm', { hasText: 'No space left' }).waitFor();
    await expect.poll(() => row.getAttribute('class')).toContain('bad');
    await page.locator('.figures', { hasText: '1 alarm' }).waitFor();
    await page.locator('.event-alarm', { hasText: 'checkpoint' }).waitFor();
    stage.mock.alarm('policy', '');
    await row.locator('.alarm').waitFor({ state: 'detached' });
    await page.locator('.event-alarm', { hasText: 'resolved' }).waitFor();
  });

  it('curves have no hole after a reconnection', async () => {
    const { page } = await stage.page('training?x=update&smooth=0&show=runs');
    await page.waitForSelector('.uplot');
    stage.mock.silence();
    await page.waitForSelector('.banner');
    stage.mock.answer();
    // It may have tried by itself before.
    await Promise.any([page.getByRole('button', { name: 'Try now' }).click(), page.locator('[data-link="open"]').waitFor()]);
    await page.locator('[data-link="open"]').waitFor();
    // A hole would be asked for again: the newest update is there within a moment of being made.
    const run = stage.mock.world.running;
    const plot = page.getByRole('img', { name: /^Reward/ });
    const seen = await eventually(
      async () => /seed 4: last (−?\d+\.\d+)/.exec((await plot.getAttribute('aria-label')) ?? '')?.[1] ?? '',
      (text) => text !== '' && Math.abs(Number(text.replace('−', '-')) - (run?.last('reward') ?? 0)) < 0.05,
    );
    expect(seen).not.toBe('');
  });
});
