// SPDX-License-Identifier: Apache-2.0
import { join } from 'node:path';
import type { Page } from 'playwright-core';
import { describe, expect, inject, it } from 'vitest';
import type { MomentSpan, PlaybackAnswer, Run } from '../../src/api/types';
import { timecode } from '../../src/maths/format';
import { Program, startDashboard } from './programs';
import { api, curve, eventually, hashOf, Stage, violations, wider } from './stage';

// A recording of the city, opened by a dashboard of its own.

const BEFORE = 1500; // milliseconds of a recording before what is counted: a test goes back to its second 1
const JUMP = 5; // seconds, of an arrow key

/** Records the city until its training has made some updates, and then for a jump more, for 8 s at least. Returns the file. */
async function record(folder: string): Promise<string> {
  const file = join(folder, 'city.mcap');
  const { wire, url } = inject('city');
  const program = Program.start('tools/record/citylearn_record', { ...wire, output: file }, { folder, name: 'record' });
  await program.says(/records to/);
  const began = Date.now();
  const lasts = (milliseconds: number): Promise<unknown> => eventually(() => Promise.resolve(Date.now() - began), (now) => now >= milliseconds, 2 * milliseconds);
  const updates = async (): Promise<number> => Math.max(...(await api<{ runs: Run[] }>(url, 'runs')).runs.filter(({ state }) => state === 'running').map((run) => run.updates ?? 0));
  await lasts(BEFORE);
  const first = await updates();
  await eventually(updates, (now) => now >= first + 6); // on a busy machine the training hardly goes on
  await lasts(Math.max(8000, Date.now() - began + 1100 * JUMP));
  await program.kill('SIGINT');
  return file;
}

describe('an open recording', () => {
  const stage = Stage.ofProgram(async (folder) => ({ open: await record(folder), speed: 'max' }), { store: false });
  const state = (): Promise<PlaybackAnswer> => api<PlaybackAnswer>(stage.url, 'playback');
  const reached = (position: number): Promise<unknown> => eventually(state, (now) => !now.seeking && Math.abs(now.position - position) < 0.6);
  const output = (page: Page): Promise<string> => page.locator('.playback output').innerText();

  /** Opens a page of the recording, which stands still at a position. */
  async function still(hash: string, position: number): Promise<Page> {
    await fetch(`${stage.url}api/playback`, { method: 'PATCH', body: JSON.stringify({ paused: true, speed: 1, position }) });
    await reached(position);
    const { page } = await stage.page(hash);
    await page.getByRole('button', { name: 'Resume' }).waitFor();
    return page;
  }

  it('has its length and what is where in it', async () => {
    const end = await eventually(state, (now) => now.ended && now.length !== null);
    expect(end.length).toBeGreaterThan(5);
    expect(end.position).toBeCloseTo(end.length ?? 0, 3);
    expect(end.marks?.episodes.some((count) => count > 0)).toBe(true);
    const { page } = await stage.page('overview');
    await page.getByRole('img', { name: /^Episodes above, updates below/ }).waitFor();
    await expect.poll(() => output(page)).toMatch(/^(\d+:\d\d) \/ \1$/);
    await page.locator('[data-link]', { hasText: 'Recording' }).waitFor();
  });

  it('is paused, resumed and hurried by buttons and keys', async () => {
    const page = await still('overview', 2);
    const { position } = await state();
    await page.keyboard.press('Space');
    await page.getByRole('button', { name: 'Pause' }).waitFor();
    await eventually(state, (now) => now.position > position);
    await page.getByRole('button', { name: 'Pause' }).click();
    await eventually(state, (now) => now.paused);
    await page.getByLabel('Speed').selectOption('0.25');
    await eventually(state, (now) => now.speed === 0.25);
    await page.getByLabel('Speed').selectOption('max');
    await eventually(state, (now) => now.speed === 'max');
    expect((await state()).paused).toBe(true);
    expect(await violations(page)).toEqual([]);
  });

  it('stands still without a service or a run that counts as lost', async () => {
    const page = await still('overview', 4);
    await page.locator('.run-card').first().waitFor();
    const began = Date.now();
    // Longer than the silence after which live services and runs count as lost.
    await eventually(async () => {
      expect(await page.locator('tr .state-lost').count()).toBe(0);
      expect((await api<{ runs: Run[] }>(stage.url, 'runs')).runs.some((run) => run.state === 'lost')).toBe(false);
      return Date.now() - began;
    }, (time) => time > 6000);
    expect((await state()).position).toBeCloseTo(4, 1);
  });

  it('shows nothing of later when an earlier position is asked for', async () => {
    const jumps = Math.floor((((await eventually(state, (now) => now.length !== null)).length ?? 0) - 1) / JUMP);
    const late = 1 + JUMP * jumps;
    const page = await still('overview', late);
    const episodes = async (): Promise<number> => (await api<{ runs: Run[] }>(stage.url, 'runs')).runs.reduce((sum, run) => sum + (run.recorded_episodes ?? 0), 0);
    const before = await eventually(episodes, (count) => count > 0);
    const { generation } = await state();
    await page.getByRole('slider', { name: 'Position' }).fill('1'); // says that it has changed, too
    await reached(1);
    expect((await state()).generation).toBe(generation + 1);
    expect((await state()).paused).toBe(true);
    expect(await episodes()).toBeLessThan(before);
    await eventually(() => output(page), (text) => text.startsWith('0:01 /'));
    // And on again, by an arrow key.
    await page.locator('h1').focus();
    for (let jump = 1; jump <= jumps; ++jump) {
      await page.keyboard.press('ArrowRight');
      await reached(1 + JUMP * jump);
      await eventually(() => output(page), (text) => text.startsWith(`${timecode(1 + JUMP * jump)} /`));
    }
    await eventually(episodes, (count) => count === before);
    expect((await state()).generation).toBe(generation + 1);
  });

  it('moves the agents of a route, and fits into 400 pixels', async () => {
    const page = await still('route', 1);
    // It plays until agents act: on a busy machine there are moments at which the env_service has lost its policy_service.
    await page.getByRole('button', { name: 'Resume' }).click();
    await page.locator('.map .walker').first().waitFor();
    await page.setViewportSize({ width: 400, height: 800 });
    await eventually(() => wider(page), (pixels) => pixels <= 0);
    await expect.poll(() => page.locator('.playback').boundingBox()).toMatchObject({ width: 400 });
    expect(await violations(page)).toEqual([]);
  });

  it('tells what it refuses', async () => {
    const answer = await fetch(`${stage.url}api/playback`, { method: 'PATCH', body: '{"speed": -1}' });
    expect(answer.status).toBe(400);
    expect(((await answer.json()) as { error: string }).error).toContain("'speed' must be");
  });
});

describe('the time cursor in a recording', () => {
  let file = '';
  const stage = Stage.ofProgram(async (folder) => ({ open: (file = await record(folder)) }), { store: false });
  const state = (): Promise<PlaybackAnswer> => api<PlaybackAnswer>(stage.url, 'playback');
  const steer = (change: object): Promise<Response> => fetch(`${stage.url}api/playback`, { method: 'PATCH', body: JSON.stringify(change) });
  const moment = (page: Page) => page.getByRole('group', { name: 'Moment', exact: true });
  const at = (page: Page): string | null => new URLSearchParams(hashOf(page).split('?')[1]).get('at');
  const link = (page: string, id: string, point: number | string, more = ''): string => `${page}?${page === 'training' ? 'runs' : 'run'}=${encodeURIComponent(id)}&at=${point}${more}`;

  /** Returns the run of the recording that has the most updates, and its ends. */
  async function recorded(): Promise<{ id: string; span: MomentSpan }> {
    const { spans } = await eventually(state, (now) => now.spans !== null);
    const [longest] = Object.entries(spans ?? {}).sort(([, a], [, b]) => b.last.update - b.first.update - (a.last.update - a.first.update));
    const [id, span] = longest as [string, MomentSpan];
    expect(span.last.update - span.first.update).toBeGreaterThan(4);
    return { id, span };
  }
  /** Waits until the recording stands still at an update of a run. Returns how. */
  const standing = (id: string, right: (update: number) => boolean): Promise<PlaybackAnswer> =>
    eventually(state, (now) => now.paused && !now.seeking && right(now.runs[id]?.update ?? 0));
  /** Waits until the address names the moment where the recording is. */
  const named = (page: Page, id: string): Promise<unknown> => eventually(async () => [at(page), String((await state()).runs[id]?.steps)], ([there, here]) => there === here);

  it('goes where a link says, and the curves are of that moment', async () => {
    const { id, span } = await recorded();
    const middle = Math.round((span.first.steps + span.last.steps) / 2);
    const { page, complaints } = await stage.page(link('training', id, middle));
    const there = await standing(id, (update) => update > span.first.update && update < span.last.update);
    expect(Math.abs((there.runs[id]?.steps ?? 0) - middle)).toBeLessThanOrEqual(middle - span.first.steps);
    await named(page, id);
    for (const name of [/^Reward/, /^SPL/, /^Entropy/]) await eventually(() => curve(page, name), (label) => /; at [\d.]+[kM]?: .*: /.test(label));
    await expect.poll(() => moment(page).innerText()).toContain(`update ${there.runs[id]?.update?.toLocaleString('en')} `);
    expect(await violations(page)).toEqual([]);
    // Loading it again moves nothing: the recording is there.
    await page.reload();
    await moment(page).waitFor();
    await named(page, id);
    expect(await state()).toMatchObject({ generation: there.generation, position: there.position, paused: true });
    expect(complaints).toEqual([]);
  });

  it('stops at the moment of a link, though it plays through there', async () => {
    const { id, span } = await recorded();
    const update = span.last.update - 1;
    await steer({ moment: { run: id, update }, paused: true, speed: 0.01 });
    const { runs } = await standing(id, (now) => now === update);
    await steer({ paused: false });
    const { page } = await stage.page(link('training', id, runs[id]?.steps ?? 0));
    await standing(id, (now) => now === update);
    await named(page, id);
  });

  it('goes where a curve is clicked, ahead too, and the route shows that moment', async () => {
    const { id, span } = await recorded();
    await steer({ moment: { run: id, update: span.first.update + 1 }, paused: true });
    const before = await standing(id, (update) => update === span.first.update + 1);
    const { page } = await stage.page(link('training', id, before.runs[id]?.steps ?? 0));
    await named(page, id);
    await page.getByRole('img', { name: /^Entropy/ }).scrollIntoViewIfNeeded(); // it is drawn when it is in sight
    const plot = page.getByRole('img', { name: /^Entropy/ }).locator('.u-over');
    // The axis reaches to the end of the recording, though its figures have not come yet.
    const box = await plot.boundingBox();
    await plot.click({ position: { x: (box?.width ?? 0) * 0.95, y: 40 } });
    const ahead = await standing(id, (update) => update > (before.runs[id]?.update ?? 0) + 1);
    expect(ahead.generation).toBe(before.generation);
    await named(page, id);
    const said = await moment(page).locator('.hint').innerText();
    expect(said).toContain(`update ${ahead.runs[id]?.update?.toLocaleString('en')} `);

    await moment(page).getByRole('link', { name: 'Route' }).click();
    await page.locator('.map .walker').first().waitFor();
    await expect.poll(() => moment(page).locator('.hint').innerText()).toBe(said);
    await eventually(() => curve(page, /^SPL in training/), (label) => /; at [\d.]+[kM]?: /.test(label));
    expect((await state()).position).toBe(ahead.position);
    expect(await page.getByText(/No news/).count()).toBe(0);
    await page.setViewportSize({ width: 400, height: 800 });
    await eventually(() => wider(page), (pixels) => pixels <= 0);
    expect(await violations(page)).toEqual([]);
    // The other axes name the same moment.
    await page.getByRole('radio', { name: 'Time' }).check({ force: true });
    await eventually(() => Promise.resolve(Number(at(page))), (seconds) => Math.abs(seconds - (ahead.runs[id]?.wall ?? 0)) < 0.001);
    expect((await state()).position).toBe(ahead.position);
  });

  it('moves while the recording is played, and when it is sent elsewhere', async () => {
    const { id, span } = await recorded();
    await steer({ moment: { run: id, update: span.first.update }, paused: true, speed: 0.5 });
    await standing(id, (update) => update === span.first.update);
    const { page } = await stage.page(link('training', id, span.first.steps, '&episode=1&step=3'));
    await named(page, id);
    expect(page.url()).toContain('&episode=1&step=3'); // a link leads to an episode of that moment
    const hint = (): Promise<string> => moment(page).locator('.hint').innerText();
    const began = await hint();
    await page.getByRole('button', { name: 'Resume' }).click();
    await eventually(hint, (text) => text !== began && text.startsWith('update '));
    await eventually(() => Promise.resolve(at(page)), (point) => point === null); // it passes
    await page.getByRole('button', { name: 'Pause' }).click();
    await eventually(state, (now) => now.paused);
    await named(page, id);
    const { position } = await state();
    await page.locator('h1').focus();
    await page.keyboard.press('ArrowRight'); // 5 s on
    await eventually(state, (now) => !now.seeking && now.position > position);
    await named(page, id);
    await eventually(async () => [await hint(), (await state()).runs[id]?.update?.toLocaleString('en')], ([text, update]) => text?.startsWith(`update ${update} `) ?? false);
    expect(page.url()).not.toMatch(/episode=|step=/); // that was of the earlier moment
  });

  it('says what the recording does not have', async () => {
    const { id, span } = await recorded();
    const { page } = await stage.page(link('training', id, span.last.steps + 1_000_000));
    await standing(id, (update) => update === span.last.update);
    await page.locator('.playback .note', { hasText: `ends at ${span.last.steps.toLocaleString('en')} steps, before` }).waitFor();
    await named(page, id);
    expect(await violations(page)).toEqual([]);
    // What it does not have is said no more where it is not meant.
    await page.evaluate((hash) => (location.hash = hash), `#/${link('training', id, span.first.steps)}`);
    await standing(id, (update) => update === span.first.update);
    await page.locator('.playback .note').waitFor({ state: 'detached' });
    await named(page, id);
    await page.evaluate((hash) => (location.hash = hash), `#/${link('route', 'city/nobody/1/5', 5)}`);
    await page.locator('.playback [role="alert"]', { hasText: "the recording has no update of run 'city/nobody/1/5'" }).waitFor();
  });

  it('begins where a link of the command line says', async () => {
    const { id, span } = await recorded();
    const middle = span.first.update + Math.floor((span.last.update - span.first.update) / 2);
    const start = (name: string, open: string[]) => startDashboard({ open }, stage.folder, { name, store: false });
    const opened = await start('linked', [file, `${stage.url}#/${link('route', id, middle, '&x=update')}`]);
    try {
      expect(opened.link).toContain(`#/route?run=${encodeURIComponent(id)}&at=${middle}&x=update`);
      await eventually(() => api<PlaybackAnswer>(opened.url, 'playback'), (now) => now.paused && !now.seeking && now.runs[id]?.update === middle);
      const { page } = await stage.page('overview');
      await page.goto(opened.link);
      await page.locator('.map .walker').first().waitFor();
      await expect.poll(() => moment(page).innerText()).toContain(`update ${middle.toLocaleString('en')} `);
    } finally {
      await opened.program.kill();
    }
    await expect(start('fileless', [`${stage.url}#/${link('route', id, 5)}`]).then(({ program }) => program.ended())).rejects.toThrow(/--open: a link does not say where its recording is \(name its files too/);
    const stranger = await start('stranger', [file, `${stage.url}#/${link('route', 'city/nobody/1/5', 5)}`]);
    await expect(stranger.program.ended()).rejects.toThrow(/the recording has no update of run 'city\/nobody\/1\/5'/);
    await expect(start('wrong', [file, `${stage.url}#/${link('route', id, 'soon')}`]).then(({ program }) => program.ended())).rejects.toThrow(/at=soon is not a number from 0 on/);
  });
});

describe('without a recording', () => {
  const stage = Stage.ofCity();

  it('there is no bar', async () => {
    const { page } = await stage.page('overview');
    await page.waitForSelector('.run-card');
    expect(await page.locator('.playback').count()).toBe(0);
    expect((await fetch(`${stage.url}api/playback`)).status).toBe(404);
  });
});
