// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { eachVisible, planeOfStreets } from '../../src/maths/streets';

// A corridor of three places to the north, driven both ways, and a one-way link from its end to the east.
const plane = planeOfStreets({
  east: [0, 0, 0, 20],
  north: [0, 10, 20, 20],
  from: [0, 1, 1, 2, 2],
  to: [1, 2, 0, 3, 1],
  place: [0, 1, 1, 2, 2],
  heading: [0, 0, 180, 90, 180],
});

describe('streets on a plane', () => {
  it('north is up, and a state is where its place is', () => {
    expect(plane.places[1]).toEqual({ x: 0, y: -10 });
    expect(plane.states[3]).toEqual({ x: 0, y: -20 });
  });
  it('both directions are one line', () => {
    expect([...plane.lines]).toEqual([0, -0, 0, -10, 0, -10, 0, -20, 0, -20, 20, -20]);
  });
  it('only what may be on the screen is drawn', () => {
    const view = { scale: 1, x: 0, y: 16 }; // y from -16 to -11
    const drawn: number[][] = [];
    expect(eachVisible(plane, view, 5, 5, (...line) => drawn.push(line))).toBe(1);
    expect(drawn[0]?.map(Math.abs)).toEqual([0, 10, 0, 20]);
  });
});
