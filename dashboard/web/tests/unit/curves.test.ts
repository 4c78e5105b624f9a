// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { linesOf, smooth, type CurveOptions, type GroupRows } from '../../src/maths/curves';
import { append, axis, latest, metric, noRows, rowsOf, type Rows } from '../../src/maths/rows';
import { aggregate, deviation, median, valueAt } from '../../src/maths/seeds';
import { TRAINING_COLUMNS } from '../../src/api/training_figures';

describe('smooth', () => {
  it('leaves a constant as it is from the first value on: it is debiased', () => {
    for (const value of smooth([3, 3, 3], [1, 2, 3], 0.9)) expect(value).toBeCloseTo(3, 12);
  });
  it('weighs as the definition says', () => {
    const [first, second] = smooth([1, 0], [1, 2], 0.9);
    expect(first).toBe(1);
    expect(second).toBeCloseTo(0.9 / 1.9, 12); // (0.9 * 1 + 1 * 0) / (0.9 + 1)
  });
  it('forgets by the updates between rows, not by rows', () => {
    const far = smooth([1, 0], [1, 51], 0.9)[1] as number;
    expect(far).toBeLessThan(0.01);
  });
  it('keeps gaps, and what came before them', () => {
    expect(smooth([2, null, 2], [1, 2, 3], 0.9)).toEqual([2, null, 2]);
  });
  it('does nothing at 0', () => {
    expect(smooth([1, 5, null], [1, 2, 3], 0)).toEqual([1, 5, null]);
  });
});

describe('valueAt', () => {
  const curve = { x: [0, 10, 20], y: [0, 1, null] };
  it('goes straight between neighbours', () => expect(valueAt(curve, 5)).toBe(0.5));
  it('is null outside and beside gaps', () => {
    expect(valueAt(curve, -1)).toBeNull();
    expect(valueAt(curve, 21)).toBeNull();
    expect(valueAt(curve, 15)).toBeNull();
    expect(valueAt(curve, 10)).toBe(1);
  });
});

describe('aggregate', () => {
  it('has mean, lowest and highest of the curves that have reached a place', () => {
    const band = aggregate([{ x: [0, 10], y: [0, 10] }, { x: [0, 5], y: [2, 7] }], 3);
    expect(band.x).toEqual([0, 5, 10]);
    expect(band.mean).toEqual([1, 6, 10]);
    expect(band.low).toEqual([0, 5, 10]);
    expect(band.high).toEqual([2, 7, 10]);
    expect(band.count).toEqual([2, 2, 1]);
  });
  it('keeps to a range', () => {
    expect(aggregate([{ x: [0, 10], y: [0, 10] }], 3, { from: 4, to: 20 }).x).toEqual([4, 7, 10]);
  });
  it('begins where every curve has begun; one without values holds nothing up', () => {
    const band = aggregate([{ x: [0, 10], y: [0, 10] }, { x: [0, 5, 10], y: [null, 3, 4] }, { x: [0, 10], y: [null, null] }], 3);
    expect(band.mean).toEqual([null, 4, 7]);
    expect(band.count).toEqual([0, 2, 2]);
  });
  it('is empty of nothing', () => expect(aggregate([{ x: [], y: [] }]).x).toEqual([]));
  it('reaches the last x of each curve in spite of rounding', () => {
    const x = [0.1, 0.3];
    const band = aggregate([{ x, y: [1, 2] }], 7);
    expect(band.count).toEqual([1, 1, 1, 1, 1, 1, 1]);
  });
});

describe('statistics', () => {
  it('medians', () => {
    expect(median([])).toBeNull();
    expect(median([3, 1, 2])).toBe(2);
    expect(median([4, 1, 2, 3])).toBe(2.5);
  });
  it('deviation is the sample one', () => {
    expect(deviation([1])).toBeNull();
    expect(deviation([1, 3])).toBeCloseTo(Math.SQRT2, 12);
  });
});

function rows(updates: number[], reward: number[]): Rows {
  const columns = Object.fromEntries(TRAINING_COLUMNS.map((name) => [name, updates.map(() => 0)]));
  return rowsOf({
    id: 'a/b/1',
    x: 'updates',
    total: updates.length,
    decimated: false,
    columns: { ...columns, x: updates, update: updates, steps: updates.map((u) => u * 100), episodes: updates.map((u) => 99 + u), reward },
  });
}

describe('rows', () => {
  it('appends what joins, NaN as unknown', () => {
    const all = rows([1, 2], [0.1, 0.2]);
    const joins = append(all, new Map([['update', [3]], ['reward', [NaN]], ['steps', [300]]]));
    expect(joins).toBe(true);
    expect(all.length).toBe(3);
    expect(all.columns.reward).toEqual([0.1, 0.2, null]);
    expect(latest(all, 'reward')).toBe(0.2);
  });
  it('has no mean over 100 episodes before so many have ended', () => {
    const all = rows([1, 2, 3], [0.76, 0.3, 0.2]);
    all.columns.episodes = [6, 99, 100];
    expect(metric(all, 'reward')).toEqual([null, null, 0.2]);
    all.columns.episode_length = [12, 90, 80];
    expect(metric(all, 'episode_length')).toEqual([null, null, 80]);
    expect(metric(all, 'steps')).toEqual([100, 200, 300]);
  });
  it('tells when updates are missing between', () => {
    expect(append(rows([1, 2], [0, 0]), new Map([['update', [5]]]))).toBe(false);
  });
  it('a resumed run replaces what it does again', () => {
    const all = rows([1, 2, 3, 4], [1, 2, 3, 4]);
    expect(append(all, new Map([['update', [3]], ['reward', [30]]]))).toBe(true);
    expect(all.columns.update).toEqual([1, 2, 3]);
    expect(all.columns.reward).toEqual([1, 2, 30]);
  });
  it('an axis never goes back', () => {
    const all = noRows();
    all.columns.wall = [1, null, 3];
    expect(axis(all, 'wall')).toEqual([1, 1, 3]);
  });
});

describe('linesOf', () => {
  const groups: GroupRows[] = [
    {
      key: 'g',
      label: 'group',
      colour: 'series-1',
      runs: [1, 2, 3].map((seed) => ({ id: `r${seed}`, label: `seed ${seed}`, colour: `series-${seed}`, rows: rows([1, 2, 3], [seed, 2 * seed, 3 * seed]) })),
    },
  ];
  const options = (changes: Partial<CurveOptions>): CurveOptions => ({
    metric: 'reward',
    x: 'steps',
    smoothing: 0,
    display: 'both',
    hidden: new Set(),
    range: null,
    ...changes,
  });
  const meanLine = (hidden: string[]) =>
    linesOf(groups, options({ hidden: new Set(hidden) })).find((line) => line.key.startsWith('mean'));

  it('the mean and the spread are the same whichever runs are shown', () => {
    const all = meanLine([]);
    expect(all?.y[0]).toBe(2);
    expect(all?.band?.low[0]).toBe(1);
    expect(all?.band?.high[0]).toBe(3);
    expect(meanLine(['r1'])).toEqual(all);
    expect(meanLine(['r1', 'r2', 'r3'])).toEqual(all);
  });
  it('hides the lines of hidden runs alone', () => {
    expect(linesOf(groups, options({ hidden: new Set(['r2']) })).map((line) => line.key)).toEqual(['r1', 'r3', 'mean g']);
    expect(linesOf(groups, options({ display: 'mean' })).map((line) => line.key)).toEqual(['mean g']);
    expect(linesOf(groups, options({ display: 'runs' })).map((line) => line.colour)).toEqual(['series-1', 'series-2', 'series-3']);
  });
  it('a group of one run is its line', () => {
    const one = [{ ...(groups[0] as GroupRows), runs: (groups[0] as GroupRows).runs.slice(0, 1) }];
    expect(linesOf(one, options({ display: 'mean' })).map((line) => [line.key, line.faint])).toEqual([['r1', false]]);
  });
  it('draws what is not smoothed faintly behind the line', () => {
    const one = [{ ...(groups[0] as GroupRows), runs: (groups[0] as GroupRows).runs.slice(0, 1) }];
    const lines = linesOf(one, options({ smoothing: 0.9 }));
    expect(lines.map((line) => [line.key, line.faint])).toEqual([['raw r1', true], ['r1', false]]);
    expect(lines[0]?.y).toEqual([1, 2, 3]);
    expect(lines[1]?.y[2]).toBeLessThan(3);
  });
  it('of updates at one count of episodes draws the last', () => {
    const flat = rows([1, 2, 3], [1, 2, 3]);
    flat.columns.episodes = [100, 100, 105];
    const one = [{ ...(groups[0] as GroupRows), runs: [{ id: 'r', label: '', colour: 'series-1', rows: flat }] }];
    const [line] = linesOf(one, options({ x: 'episodes' }));
    expect(line?.x).toEqual([100, 105]);
    expect(line?.y).toEqual([2, 3]);
  });
});
