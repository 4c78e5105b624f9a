// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { TraversalMap } from '../../src/api/types';
import { detailOf, placeOf, pointAt, pointsBetween, refined, valueAt } from '../../src/maths/outline';

const index = [0, 10, 20, 100];

describe('an outline', () => {
  it('finds the place of a frame', () => {
    expect([-1, 0, 9, 10, 99, 100, 500].map((frame) => placeOf(index, frame))).toEqual([-1, 0, 0, 1, 2, 3, 3]);
  });
  it('is straight between its frames, and has gaps where one is unknown', () => {
    expect([0, 5, 20, 60, 100].map((frame) => valueAt(index, [0, 100, 200, 1000], frame))).toEqual([0, 50, 200, 600, 1000]);
    expect([5, 15, 20, 101].map((frame) => valueAt(index, [0, null, 200, 1000], frame))).toEqual([null, null, 200, null]);
    const points = [{ x: 0, y: 0 }, { x: 10, y: 20 }, null, { x: 5, y: 5 }];
    expect(pointAt(index, points, 5)).toEqual({ x: 5, y: 10 });
    expect([pointAt(index, points, 15), pointAt(index, points, 60), pointAt(index, points, -1)]).toEqual([null, null, null]);
    expect(pointsBetween(index, points, 5, 100)).toEqual([{ x: 5, y: 10 }, { x: 10, y: 20 }, null, { x: 5, y: 5 }, { x: 5, y: 5 }]);
    expect(pointsBetween(index, points, 7, 6)).toEqual([]);
  });
  it('takes a part in more detail', () => {
    const map: TraversalMap = { hash: 'a', frames: 101, index, position: null, latitude: [0, 1, 2, 10], longitude: [5, 5, 5, 5], streets: null };
    const part: TraversalMap = { ...map, index: [8, 12, 16], latitude: [0.8, 1.5, 1.6], longitude: [5, 5, 5] };
    const both = refined(map, part);
    expect(both.index).toEqual([0, 8, 12, 16, 20, 100]);
    expect(both.latitude).toEqual([0, 0.8, 1.5, 1.6, 2, 10]);
    expect(both.position).toBeNull();
    expect(refined(map, { ...part, hash: 'b' })).toBe(map);
    expect(refined(map, { ...part, index: [] })).toBe(map);
  });
  it('asks for the part on the screen when it has too little of it', () => {
    // A point each 100 frames and 100 metres, along x.
    const frames = 100_000;
    const kept = Array.from({ length: 1001 }, (_, i) => Math.min(100 * i, frames - 1));
    const points = kept.map((x) => ({ x, y: 0 }));
    const part = (scale: number, x: number): string | null => detailOf({ index: kept, frames }, points, { scale, x, y: 50 }, 400, 100);
    expect(part(0.004, 0)).toBeNull(); // all of it
    expect(part(1, -1050)).toBe('?first=512&last=1535'); // 1000 to 1500 are on the screen
    expect(part(1, -1060)).toBe(part(1, -1050));
    expect(detailOf({ index: kept, frames }, points, { scale: 1, x: -1000, y: 500 }, 400, 100)).toBeNull(); // beside the route
    expect(detailOf({ index: [0, 1, 2], frames: 3 }, points.slice(0, 3), { scale: 1, x: 0, y: 0 }, 400, 100)).toBeNull();
  });
});
