// SPDX-License-Identifier: Apache-2.0
import { join } from 'node:path';
import type { Page } from 'playwright-core';
import { describe, expect, inject, it } from 'vitest';
import type { PlaybackAnswer, Run } from '../../src/api/types';
import { Program } from './programs';
import { api, eventually, Stage, violations, wider } from './stage';

// A recording of the city, opened by a dashboard of its own.

/** Records the city until the recording has so many seconds. Returns the file. */
async function record(folder: string, seconds: number): Promise<string> {
  const file = join(folder, 'city.mcap');
  const { wire } = inject('city');
  const program = Program.start('tools/record/citylearn_record', { ...wire, output: file }, { folder, name: 'record' });
  await program.says(/records to/);
  const end = Date.now() + 1000 * seconds;
  await eventually(() => Promise.resolve(Date.now()), (now) => now >= end, 2000 * seconds);
  await program.kill('SIGINT');
  return file;
}

describe('an open recording', () => {
  const stage = Stage.ofProgram(async (folder) => ({ open: await record(folder, 8), speed: 'max' }), { store: false });
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
    expect(await output(page)).toMatch(/^0:0\d \/ 0:0\d$/);
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
    const page = await still('overview', 6);
    const updates = async (): Promise<number> => Math.max(0, ...(await api<{ runs: Run[] }>(stage.url, 'runs')).runs.map((run) => run.recorded_episodes ?? 0));
    const before = await eventually(updates, (count) => count > 0);
    const { generation } = await state();
    await page.getByRole('slider', { name: 'Position' }).fill('1');
    await page.getByRole('slider', { name: 'Position' }).dispatchEvent('change');
    await reached(1);
    expect((await state()).generation).toBe(generation + 1);
    expect((await state()).paused).toBe(true);
    expect(await updates()).toBeLessThan(before);
    await eventually(() => output(page), (text) => text.startsWith('0:01 /'));
    // And on again, by an arrow key.
    await page.locator('h1').focus();
    await page.keyboard.press('ArrowRight');
    await reached(6);
    await eventually(updates, (count) => count === before);
    expect((await state()).generation).toBe(generation + 1);
  });

  it('moves the agents of a route, and fits into 400 pixels', async () => {
    const page = await still('route', 3);
    await page.locator('.map .walker').first().waitFor();
    await page.setViewportSize({ width: 400, height: 800 });
    await eventually(() => wider(page), (pixels) => pixels <= 0);
    expect(await page.locator('.playback').boundingBox()).toMatchObject({ width: 400 });
    expect(await violations(page)).toEqual([]);
  });

  it('tells what it refuses', async () => {
    const answer = await fetch(`${stage.url}api/playback`, { method: 'PATCH', body: '{"speed": -1}' });
    expect(answer.status).toBe(400);
    expect(((await answer.json()) as { error: string }).error).toContain("'speed' must be");
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
