// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { fit, nearest, niceBelow, project, scaleBar, ticks, toScreen, zoomAt, type Point } from '../../src/maths/geometry';

describe('project', () => {
  it('has north up and metres', () => {
    const points = project([60, 60.001], [10, 10]) as Point[];
    const [south, north] = points as [Point, Point];
    expect(north.y).toBeLessThan(south.y);
    expect(south.y - north.y).toBeCloseTo(111.19, 1); // a thousandth of a degree of latitude
    expect(south.x).toBeCloseTo(north.x, 9);
  });
  it('a degree of longitude is shorter in the north', () => {
    const [west, east] = project([60, 60], [10, 10.001]) as [Point, Point];
    expect(east.x - west.x).toBeCloseTo(111.19 * Math.cos(Math.PI / 3), 1);
  });
  it('goes on across longitude 180', () => {
    const [west, east] = project([0, 0], [179.9995, -179.9995]) as [Point, Point];
    expect(east.x - west.x).toBeCloseTo(111.19, 1);
  });
  it('keeps places that are unknown', () => {
    expect((project([60, null, 61], [10, 10, 10]) as (Point | null)[])[1]).toBeNull();
    expect(project([60, null], [10, 10])).toBeNull();
  });
});

describe('fit', () => {
  it('shows all points, centred, in the margins', () => {
    const points = [{ x: -50, y: 0 }, null, { x: 50, y: 10 }];
    const view = fit(points, 400, 300, 20);
    expect(toScreen(view, { x: -50, y: 5 })).toEqual({ x: 20, y: 150 });
    expect(toScreen(view, { x: 50, y: 5 })).toEqual({ x: 380, y: 150 });
  });
  it('survives one place, and none', () => {
    expect(toScreen(fit([{ x: 3, y: 3 }], 100, 100, 10), { x: 3, y: 3 })).toEqual({ x: 50, y: 50 });
    expect(fit([], 100, 100, 10).scale).toBe(1);
  });
  it('of a straight line along x uses the width', () => {
    const view = fit([{ x: 0, y: 0 }, { x: 10, y: 0 }], 120, 50, 10);
    expect(view.scale).toBe(10);
  });
});

it('zooming leaves the point where it is', () => {
  const view = { scale: 2, x: 10, y: 20 };
  const about = toScreen(view, { x: 7, y: 9 });
  expect(toScreen(zoomAt(view, about, 3), { x: 7, y: 9 })).toEqual(about);
});

it('round numbers', () => {
  expect([1, 1.9, 2, 4.9, 7, 99, 0.03].map(niceBelow).map((v) => Number(v.toPrecision(3)))).toEqual([1, 1, 2, 2, 5, 50, 0.02]);
  const bar = scaleBar({ scale: 0.3, x: 0, y: 0 }, 160);
  expect(bar.length).toBe(500);
  expect(bar.pixels).toBeCloseTo(150, 9);
  expect(ticks(17, 144, 6)).toEqual([20, 40, 60, 80, 100, 120, 140]);
  expect(ticks(0, 3, 10)).toEqual([0, 1, 2, 3]);
});

it('finds the nearest point within reach', () => {
  const points = [{ x: 0, y: 0 }, null, { x: 10, y: 0 }];
  expect(nearest(points, { x: 8, y: 0 }, 5)).toBe(2);
  expect(nearest(points, { x: 5, y: 9 }, 5)).toBe(-1);
});
