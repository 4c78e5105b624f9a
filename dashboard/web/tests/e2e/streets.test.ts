// SPDX-License-Identifier: Apache-2.0
import { afterAll, describe, expect, inject, it } from 'vitest';
import type { Episode, EpisodeDetail, Run, TraversalMap } from '../../src/api/types';
import { Program, type Options } from './programs';
import { api, eventually, Stage } from './stage';

describe('streets', () => {
  const programs: Program[] = [];
  const stage = Stage.ofProgram((folder): Options => {
    const wire: Options = { ...inject('city').wire, session: 'streets' };
    const start = (service: string, id: string, options: Options): void => {
      programs.push(Program.start(`${service}/${service}`, { ...wire, id, ...options }, { folder, name: id, nice: true }));
    };
    for (const traversal of ['summer', 'fall'])
      start('env_service', `env-${traversal}`, { dataset: 'synthetic', 'synthetic-images': 0, rule: 'street', agents: 4, recorders: 'dashboard', traversal });
    start('policy_service', 'policy', { mode: 'evaluate', agent: 'sequence_filter', train: 'summer', evaluate: 'fall', tasks: 1_000_000, wait: 60 });
    return wire;
  });
  afterAll(async () => {
    await Promise.all(programs.map((program) => program.kill('SIGKILL')));
  });

  it('are drawn beneath agents that face somewhere', async () => {
    const { page, complaints } = await stage.page('route?env=env-fall');
    const drawn = (): Promise<boolean> =>
      page.locator('canvas.streets').evaluate((canvas: HTMLCanvasElement) => canvas.getContext('2d')?.getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value > 0) ?? false);
    await eventually(drawn, (now) => now);
    await eventually(() => page.locator('.walker > path').count(), (count) => count === 4); // a heading each
    const positions = (): Promise<string[]> => page.locator('section[aria-label="Agents"] tbody td:nth-child(2)').allInnerTexts();
    const seen = new Set<string>();
    await eventually(positions, (now) => seen.add(now.join()).size > 3);
    expect(await page.getByRole('columnheader', { name: 'To go' }).count()).toBe(0); // states are not in a row
    expect(complaints).toEqual([]);
  });

  it('are there when the env_services are gone, and say where an episode went', async () => {
    const [run] = (await api<{ runs: Run[] }>(stage.url, 'runs')).runs;
    const path = `runs/${encodeURIComponent(run?.id ?? '')}/episodes?limit=1&evaluation=1`;
    const [episode] = (await eventually(() => api<{ episodes: Episode[] }>(stage.url, path), ({ episodes }) => episodes.length > 0)).episodes;
    const detail = (): Promise<EpisodeDetail> => api<EpisodeDetail>(stage.url, `episodes/${episode?.rowid}`);
    const { positions, hash } = await eventually(detail, (one) => one.positions !== null);
    expect(positions).toHaveLength((episode?.steps ?? 0) + 1);
    const { streets } = await api<TraversalMap>(stage.url, `map/${hash}`);
    expect(streets?.place[positions?.at(-1) ?? 0]).toBe(episode?.goal);
    await Promise.all(programs.map((program) => program.kill('SIGKILL')));
    const { page } = await stage.page(`deployment?run=${encodeURIComponent(run?.id ?? '')}&episode=${episode?.rowid}&step=1`);
    await page.locator('canvas.streets').waitFor();
    await page.locator('.walker', { hasText: 'goal' }).waitFor();
  });
});
