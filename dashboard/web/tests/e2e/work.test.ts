// SPDX-License-Identifier: Apache-2.0
import { existsSync } from 'node:fs';
import { beforeAll, describe, expect, it } from 'vitest';
import type { Page } from 'playwright-core';
import type { Episode, Run, TrainingAnswer } from '../../src/api/types';
import { api, curve, eventually, hashOf, saved, Stage, violations, zoom } from './stage';

const stage = Stage.ofCity();

// Runs by the ID of their policy_service: three seeds of `policy`, a `spare` one with another option, and `live`.
let runs: Run[] = [];
beforeAll(async () => {
  runs = (await api<{ runs: Run[] }>(stage.url, 'runs')).runs;
});
const idOf = (policy: string): string => encodeURIComponent(runs.find((run) => run.policy === policy)?.id ?? '');

/** Cells of a line of CSV without quotes in them. */
const cells = (line = ''): string[] => [...line.matchAll(/(?:^|,)(?:"([^"]*)"|([^,]*))/g)].map((match) => match[1] ?? match[2] ?? '');

describe('training', () => {
  // A group whose runs have all ended: nothing moves while it is looked at.
  const ended = (params = ''): string => `training?runs=${idOf('policy')}${params}`;

  it('the mean of the seeds stays the same when a seed is hidden', async () => {
    const { page } = await stage.page(ended());
    const mean = await eventually(() => curve(page, /^SPL/), (label) => label.includes('mean of 3: last'));
    const csv = async (): Promise<string[]> => (await saved(page, 'Download SPL as CSV'))[1].trim().split('\r\n');
    const before = await csv();
    await page.getByRole('checkbox', { name: /^seed 3/ }).click();
    await page.waitForFunction(() => location.hash.includes('hide='));
    await expect.poll(() => curve(page, /^SPL/)).toBe(mean);
    const after = await eventually(csv, (lines) => cells(lines[0]).length === cells(before[0]).length - 1);
    const meanOf = (lines: string[]): string[] => {
      const column = cells(lines[0]).findIndex((name) => name.includes('lowest')) - 1;
      expect(column).toBeGreaterThan(0);
      return lines.slice(1).map((line) => cells(line)[column] ?? '').filter(Boolean);
    };
    expect(meanOf(after)).toEqual(meanOf(before));
  });

  it('shows the controls as reference lines', async () => {
    const { page } = await stage.page(ended());
    const references = page.locator('section[aria-label="SPL"] .legend');
    await references.getByText('blind, summer').waitFor();
    await expect.poll(() => references.innerText()).toMatch(/shortest path, summer\s*1\.000/);
    await expect.poll(() => references.innerText()).toContain('sequence filter, summer');
  });

  it('has other axes, and smoothing', async () => {
    const { page, complaints } = await stage.page(ended());
    const entropy = (): Promise<string> => curve(page, /^Entropy/);
    const smoothed = await eventually(entropy, (label) => label.includes('mean of 3: last'));
    await page.getByRole('slider', { name: /Smoothing/ }).fill('0');
    await eventually(entropy, (now) => now !== smoothed);
    await page.getByRole('radio', { name: 'Time' }).check({ force: true });
    await expect.poll(entropy).toContain('over wall time');
    expect(complaints).toEqual([]);
    expect(await violations(page)).toEqual([]);
  });

  it('fetches the figures that the store got after it was asked', async () => {
    const figures = (page: Page): Promise<string> => curve(page, /^Entropy/);
    const whole = (text: string): boolean => text.includes('mean of 3: last');
    const { page: before } = await stage.page(ended());
    const newest = await eventually(() => figures(before), whole);
    const { page } = await stage.page('overview');
    let early = true;
    await page.route('**/training?*', async (route) => {
      const answer = (await (await route.fetch()).json()) as TrainingAnswer;
      if (early) for (const name of Object.keys(answer.columns)) answer.columns[name] = answer.columns[name]?.slice(0, 10) ?? [];
      await route.fulfill({ json: answer });
    });
    await page.goto(`${stage.url}#/${ended()}`);
    expect(await eventually(() => figures(page), whole)).not.toBe(newest);
    early = false;
    await expect.poll(() => figures(page)).toBe(newest);
  });

  it('asks for the points of a part of a long run', async () => {
    const { page } = await stage.page('overview');
    const asked: string[] = [];
    await page.route('**/training?*', (route) => {
      asked.push(route.request().url());
      return route.continue({ url: route.request().url().replace(/points=\d+/, 'points=10') }); // as if the run were long
    });
    await page.goto(`${stage.url}#/training?runs=${idOf('policy')}`);
    await page.waitForSelector('.uplot');
    await zoom(page, 100, 140);
    await eventually(() => Promise.resolve(asked.filter((one) => one.includes('from='))), (parts) => parts.length > 0);
    await page.getByRole('button', { name: 'Whole range' }).first().click();
  });
});

describe('deployment', () => {
  it('leads from an evaluation to its worst tasks and replays one by keys', async () => {
    const { page, complaints } = await stage.page(`deployment?run=${idOf('policy')}`);
    await page.getByRole('button', { name: /^Worst tasks of place_filter, update \d+ on winter$/ }).first().click();
    const row = page.locator('#episodes tbody tr').first();
    await row.getByRole('cell', { name: 'winter', exact: true }).waitFor();
    await row.getByRole('button').click();
    const slider = page.getByRole('slider', { name: 'Step' });
    await slider.waitFor();
    await expect.poll(() => slider.evaluate((element) => element === document.activeElement)).toBe(true);
    const step = page.locator('.transport output');
    await expect.poll(() => step.innerText()).toMatch(/^0 \//);
    // The picture of the place, and of the same place on the other traversal, follow the step.
    const frames = page.locator('.player .picture figcaption .number');
    const here = async (): Promise<string> => `frame ${/frame (\d+)/.exec((await slider.getAttribute('aria-valuetext')) ?? '')?.[1]}`;
    const follow = (): Promise<unknown> => eventually(async () => [await here(), ...(await frames.allInnerTexts())].join(), (all) => /^(frame \d+),\1,\1$/.test(all));
    await follow();
    await page.keyboard.press('ArrowRight');
    await expect.poll(() => step.innerText()).toMatch(/^1 \//);
    await follow();
    await page.keyboard.press('Space');
    await page.getByRole('button', { name: 'Pause' }).waitFor();
    await eventually(() => step.innerText(), (text) => Number(text.split(' ')[0]) >= 3);
    await page.keyboard.press('End');
    await expect.poll(() => step.innerText()).toMatch(/^(\d+) \/ \1$/);
    await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
    expect(await violations(page)).toEqual([]);
    expect(complaints).toEqual([]);
  });

  it('says so when the actions of an episode were not kept', async () => {
    const { episodes } = await api<{ episodes: Episode[] }>(stage.url, `runs/${idOf('policy')}/episodes?limit=1`);
    const rowid = episodes[0]?.rowid ?? 0;
    const { page } = await stage.page('overview');
    await page.route(`**/api/episodes/${rowid}`, async (route) => {
      const response = await route.fetch();
      await route.fulfill({ json: { ...((await response.json()) as object), positions: null } });
    });
    await page.goto(`${stage.url}#/deployment?run=${idOf('policy')}&episode=${rowid}`);
    await page.getByText('The actions of this episode were not recorded').waitFor();
  });
});

describe('compare', () => {
  it('shows what differs in the manifests; groups count every run', async () => {
    const { page } = await stage.page('compare');
    const manifests = page.locator('section[aria-label="Manifests"]');
    await manifests.getByText('parameters.learner.gamma').waitFor();
    expect(await manifests.getByText('parameters.learner.clip').count()).toBe(0);
    const groups = page.locator('section[aria-label="Over seeds"] tbody tr', { hasText: 'session city' }).filter({ has: page.getByRole('cell', { name: '3', exact: true }) });
    const before = await groups.innerText();
    await page.locator('section[aria-label="Runs"] input[type=checkbox]:checked').last().click();
    await page.waitForFunction(() => location.hash.includes('runs='));
    await expect.poll(() => groups.innerText()).toBe(before);
    await manifests.getByRole('radio', { name: 'All' }).check({ force: true });
    await manifests.getByText('parameters.learner.clip').waitFor();
  });

  it('names the files of the chosen runs', async () => {
    const { page } = await stage.page(`compare?runs=${idOf('spare')}`);
    const files = page.locator('section[aria-label="Files"]');
    await files.locator('.path').first().waitFor();
    const paths = await files.locator('.path').allInnerTexts();
    const folder = paths[0]?.replace(/\/summary\.json$/, '') ?? '';
    expect(folder).toMatch(/^\/.*\/spare$/);
    expect(paths).toContain(`${folder}/checkpoints/best.clk`);
    for (const path of paths.filter((one) => one !== `${folder}/checkpoints/best.clk`)) expect(existsSync(path), path).toBe(true);
    // They are no options, in which runs differ.
    expect(await page.locator('section[aria-label="Manifests"]').getByText('artefacts').count()).toBe(0);
  });

  it('removes a run only when it is said twice', async () => {
    const { page } = await stage.page('compare');
    const rows = page.locator('section[aria-label="Runs"] tbody tr');
    await rows.first().waitFor();
    const count = await rows.count();
    const spare = rows.nth(runs.findIndex((run) => run.policy === 'spare'));
    await spare.getByRole('button', { name: /^Remove place_filter/ }).click();
    await page.getByRole('button', { name: 'Keep' }).click();
    expect(await rows.count()).toBe(count);
    await spare.getByRole('button', { name: /^Remove place_filter/ }).click();
    await page.getByRole('button', { name: 'Remove with its episodes' }).click();
    await eventually(() => rows.count(), (now) => now === count - 1);
  });
});

describe('a link', () => {
  it('shows the same curves: runs, axis, smoothing and the part in sight', async () => {
    const { page } = await stage.page('training');
    await page.waitForFunction(() => location.hash.includes('runs='));
    await page.goto(`${stage.url}#/training?runs=${idOf('policy')}`);
    await page.getByRole('radio', { name: 'Episodes' }).check({ force: true });
    await page.getByRole('slider', { name: /Smoothing/ }).fill('0.5');
    await zoom(page, 60, 160);
    await page.waitForFunction(() => /from=.*to=/.test(location.hash));
    const { page: other } = await stage.page(hashOf(page));
    const both = (): Promise<string[]> => Promise.all([page, other].map(async (one) => (await saved(one, 'Download Reward as CSV'))[1]));
    const [rows = ''] = await eventually(both, ([one, same]) => one === same);
    expect(Number(rows.split('\r\n')[1]?.split(',')[0])).toBeGreaterThan(0); // a part of the axis
    await expect.poll(() => other.getByRole('slider', { name: /Smoothing/ }).inputValue()).toBe('0.5');
  });

  it('shows the same step of an episode at the same speed', async () => {
    const { episodes } = await api<{ episodes: Episode[] }>(stage.url, `runs/${idOf('policy')}/episodes?limit=1&evaluation=1&order=worst`);
    const { page } = await stage.page(`deployment?run=${idOf('policy')}&episode=${episodes[0]?.rowid}`);
    const slider = page.getByRole('slider', { name: 'Step' });
    for (const step of ['1', '2']) {
      await slider.press('ArrowRight'); // focuses it first: the page does so a moment after the slider is there
      await expect.poll(() => slider.inputValue()).toBe(step);
    }
    await page.getByLabel('Steps per second').selectOption('50');
    await page.waitForFunction(() => /step=2&.*speed=50/.test(location.hash));
    const { page: other } = await stage.page(hashOf(page));
    const output = other.locator('.transport output');
    await output.waitFor();
    const step = await page.locator('.transport output').innerText();
    await expect.poll(() => output.innerText()).toBe(step);
    await expect.poll(() => other.getByLabel('Steps per second').inputValue()).toBe('50');
  });
});

it('is used by keyboard alone: from the first link to a page and its title', async () => {
  const { page } = await stage.page('overview');
  await page.waitForSelector('h1');
  await page.keyboard.press('Tab');
  await expect.poll(() => page.evaluate(() => document.activeElement?.textContent)).toBe('Skip to the content');
  await page.keyboard.press('Tab');
  await page.keyboard.press('Tab');
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => document.querySelector('h1')?.textContent === 'Training');
  await expect.poll(() => page.evaluate(() => document.activeElement?.tagName)).toBe('H1');
});
