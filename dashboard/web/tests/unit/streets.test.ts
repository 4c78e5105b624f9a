// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { planeOfStreets, visibleStreets } from '../../src/maths/streets';

const text = (points: readonly { x: number; y: number }[]): string => points.map(({ x, y }) => `${x},${-y}`).join(' ');

describe('streets on a plane', () => {
  // A corridor of three places to the north, driven both ways; a one-way link from its end to the east, and one beyond.
  const plane = planeOfStreets({
    east: [0, 0, 0, 20, 0],
    north: [0, 10, 20, 20, 30],
    from: [0, 1, 1, 2, 2, 2, 4],
    to: [1, 2, 0, 3, 1, 4, 2],
    place: [0, 1, 1, 2, 2, 2, 4],
    heading: [0, 0, 180, 90, 180, 0, 180],
  });
  it('north is up, and a state is where its place is', () => {
    expect(plane.places[1]).toEqual({ x: 0, y: -10 });
    expect(plane.states[3]).toEqual({ x: 0, y: -20 });
  });
  it('a street runs from junction to junction, once for both directions', () => {
    expect(plane.streets.map(({ points }) => text(points)).sort()).toEqual(['0,0 0,10 0,20', '0,20 0,30', '0,20 20,20']);
  });
  it('only what may be on the screen is drawn', () => {
    const seen = visibleStreets(plane, { scale: 1, x: -5, y: 25 }, 5, 6); // x from 5 to 10, y from -25 to -19
    expect(seen.map(({ points }) => text(points))).toEqual(['0,20 20,20']);
  });
});

it('a ring of streets has no end, and is drawn whole', () => {
  const ring = planeOfStreets({ east: [0, 1, 1], north: [0, 0, 1], from: [0, 1, 2], to: [1, 2, 0], place: [0, 1, 2], heading: [90, 0, 225] });
  expect(ring.streets.map(({ points }) => text(points))).toEqual(['0,0 1,0 1,1 0,0']);
});
