// SPDX-License-Identifier: Apache-2.0
import { describe, expect, inject, it } from 'vitest';
import type { Page } from 'playwright-core';
import type { Run, Services, TrainingAnswer } from '../../src/api/types';
import { significant } from '../../src/maths/format';
import { startDashboard } from './programs';
import { api, between, eventually, Stage } from './stage';

/** Steps of the running run's card on the overview. */
const steps = (page: Page): Promise<string> => page.locator('.run-card .pairs dd').nth(2).innerText();

describe('live', () => {
  const stage = Stage.ofCity();

  it('curves grow', async () => {
    const { page } = await stage.page('training?show=runs');
    const plot = page.getByRole('img', { name: /^Steps per second/ });
    await plot.scrollIntoViewIfNeeded();
    const first = await plot.getAttribute('aria-label');
    await eventually(() => plot.getAttribute('aria-label'), (now) => now !== first);
  });

  it('agents move: what the chosen one sees and the same place on the sibling are pictures of one frame', async () => {
    const { page } = await stage.page('route');
    const frames = (): Promise<string[]> =>
      page.evaluate(() => [...document.querySelectorAll<HTMLElement>('.picture figcaption .number')].map((one) => one.innerText));
    const seen = new Set<string>();
    await eventually(frames, (now) => {
      if (now.length === 2) expect(now[0]).toBe(now[1]);
      return now.length === 2 && seen.add(now[0] ?? '').size > 4;
    });
    await expect.poll(() => page.locator('.picture img').first().evaluate((img: HTMLImageElement) => img.naturalWidth)).toBeGreaterThan(0);
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

describe('a run of which only episodes are known', () => {
  const stage = Stage.ofCity();

  it('is shown until the page hears of another', async () => {
    let known = false;
    const told = (json: unknown): unknown => {
      const { runs } = json as { runs?: Run[] };
      const stray = runs?.slice(0, 1).map((run) => ({ ...run, id: 'stray', session: 'stray', policy: null }));
      return runs && !known ? { ...(json as object), runs: stray } : json;
    };
    for (const name of ['training', 'route']) {
      known = false;
      let tell: (topic: string, json: object) => void = () => undefined;
      const { page } = await stage.page(name, {}, async (one) => (tell = await between(one, told)));
      await page.locator('main', { hasText: 'stray' }).waitFor();
      expect(page.url()).not.toContain('stray');
      known = true;
      tell('runs', await api<object>(stage.url, 'runs'));
      await page.waitForFunction(() => /run(s)?=[^&]*live/.test(decodeURIComponent(location.hash)));
    }
  });
});

describe('a dashboard that is killed and started again', () => {
  const stage = Stage.ofProgram(() => ({ ...inject('city').wire, id: 'second', leave: true }));

  it('is missed, keeps what the page had, and is found again; curves have no hole then', async () => {
    const { page } = await stage.page('overview');
    await page.waitForSelector('.run-card');
    const { page: curves } = await stage.page('training?x=update&smooth=0&show=runs');
    await curves.waitForSelector('.uplot');
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
    // A hole would be asked for again: the newest update is there within a moment of being stored.
    await curves.locator('[data-link="open"]').waitFor();
    const { runs } = await api<{ runs: Run[] }>(stage.url, 'runs');
    const id = runs.find(({ state }) => state === 'running')?.id ?? '';
    const plot = curves.getByRole('img', { name: /^Entropy/ });
    await plot.scrollIntoViewIfNeeded();
    await eventually(async () => {
      const { columns } = await api<TrainingAnswer>(stage.url, `runs/${encodeURIComponent(id)}/training?columns=update,entropy`);
      return [await plot.getAttribute('aria-label'), significant(columns.entropy?.at(-1))] as const;
    }, ([label, newest]) => label?.includes(`: last ${newest}`) ?? false);
  });
});

describe('what a service seldom says', () => {
  const stage = Stage.ofCity();

  it('an alarm stands in its service\'s row, in the overview and among the events until it is over', async () => {
    let alarm = '';
    let tell: (topic: string, json: object) => void = () => undefined;
    const told = (json: unknown): unknown => {
      const { services } = json as Partial<Services>;
      return services ? { ...(json as Services), services: services.map((one) => (one.id === 'live' ? { ...one, alarm } : one)) } : json;
    };
    const { page } = await stage.page('overview', {}, async (one) => (tell = await between(one, told)));
    const row = page.getByRole('row', { name: /^live / });
    await row.locator('.state-running').waitFor();
    expect(await row.locator('.alarm').count()).toBe(0);
    const say = (now: string): void => {
      alarm = now;
      tell('events', { time: Date.now() / 1000, session: 'city', service: 'live', kind: 'alarm', text: now || 'resolved' });
    };
    say('checkpoint: No space left on device');
    await row.locator('.alarm', { hasText: 'No space left' }).waitFor();
    await expect.poll(() => row.getAttribute('class')).toContain('bad');
    await page.locator('.figures', { hasText: '1 alarm' }).waitFor();
    await page.locator('.event-alarm', { hasText: 'checkpoint' }).waitFor();
    say('');
    await row.locator('.alarm').waitFor({ state: 'detached' });
    await page.locator('.event-alarm', { hasText: /live.*resolved/ }).waitFor();
  });
});
