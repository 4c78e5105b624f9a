// SPDX-License-Identifier: Apache-2.0
import type { TraversalMap } from '../api/types';
import type { Point, View } from './geometry';

type Streets = NonNullable<TraversalMap['streets']>;

/** Streets on a plane in metres, y falling to the north. */
export interface StreetPlane {
  /** Where each place is, and each state. */
  places: Point[];
  states: Point[];
  /** The two ends of each line, once for both directions: x, y, x, y. */
  lines: Float32Array;
  /** Of each state, degrees clockwise from north. */
  heading: readonly number[];
}

export function planeOfStreets({ east, north, from, to, place, heading }: Streets): StreetPlane {
  const places = east.map((x, i) => ({ x, y: -(north[i] ?? 0) }));
  const at = (index: number | undefined): Point => places[index ?? -1] ?? { x: 0, y: 0 };
  const seen = new Set<number>();
  const ends: number[] = [];
  from.forEach((a, i) => {
    const b = to[i] ?? a;
    const key = Math.min(a, b) * places.length + Math.max(a, b);
    if (seen.has(key)) return;
    seen.add(key);
    ends.push(at(a).x, at(a).y, at(b).x, at(b).y);
  });
  return { places, states: place.map(at), lines: Float32Array.from(ends), heading };
}

/** Calls `draw` for each line that may be on the screen. Returns how many. */
export function eachVisible({ lines }: StreetPlane, view: View, width: number, height: number, draw: (x1: number, y1: number, x2: number, y2: number) => void): number {
  const [left, top] = [-view.x / view.scale, -view.y / view.scale];
  const [right, bottom] = [left + width / view.scale, top + height / view.scale];
  let count = 0;
  for (let i = 0; i < lines.length; i += 4) {
    const [x1, y1, x2, y2] = [lines[i] as number, lines[i + 1] as number, lines[i + 2] as number, lines[i + 3] as number];
    if (Math.max(x1, x2) < left || Math.min(x1, x2) > right || Math.max(y1, y2) < top || Math.min(y1, y2) > bottom) continue;
    draw(x1, y1, x2, y2);
    ++count;
  }
  return count;
}
