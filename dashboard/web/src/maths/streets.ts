// SPDX-License-Identifier: Apache-2.0
import type { TraversalMap } from '../api/types';
import { greatest, least, type Point, type View } from './geometry';

type Streets = NonNullable<TraversalMap['streets']>;

/** The places of a street from one junction, dead end or corner of the map to the next. */
export interface Street {
  points: Point[];
  left: number;
  right: number;
  top: number;
  bottom: number;
}

/** Streets on a plane in metres, y falling to the north. */
export interface StreetPlane {
  /** Where each place is, and each state. */
  places: Point[];
  states: Point[];
  /** Each link is part of one street, which stands for both directions. */
  streets: Street[];
  /** Of each state, degrees clockwise from north. */
  heading: readonly number[];
}

export function planeOfStreets({ east, north, from, to, place, heading }: Streets): StreetPlane {
  const places = east.map((x, i) => ({ x, y: -(north[i] ?? 0) }));
  const at = (index: number): Point => places[index] ?? { x: 0, y: 0 };
  const beside: Set<number>[] = places.map(() => new Set());
  from.forEach((a, i) => {
    const b = to[i] ?? a;
    beside[a]?.add(b);
    beside[b]?.add(a);
  });
  const passed = (index: number): boolean => beside[index]?.size === 2;
  const ends = places.map((_, index) => index).filter((index) => !passed(index));
  const left: Set<number>[] = beside.map((others) => new Set(others)); // those to which no street leads yet
  const streets: Street[] = [];
  // Rings have no end: the rest begins anywhere.
  for (const start of [...ends, ...places.keys()])
    for (const first of [...(left[start] ?? [])]) {
      if (!left[start]?.has(first)) continue;
      const points = [at(start)];
      for (let here = start, next: number | undefined = first; next !== undefined; ) {
        left[here]?.delete(next);
        left[next]?.delete(here);
        points.push(at(next));
        here = next;
        next = passed(here) ? [...(left[here] ?? [])][0] : undefined;
      }
      const [xs, ys] = [points.map((point) => point.x), points.map((point) => point.y)];
      streets.push({ points, left: least(xs), right: greatest(xs), top: least(ys), bottom: greatest(ys) });
    }
  return { places, states: place.map(at), streets, heading };
}

/** Returns the streets that may be on the screen. */
export function visibleStreets({ streets }: StreetPlane, view: View, width: number, height: number): Street[] {
  const [left, top] = [-view.x / view.scale, -view.y / view.scale];
  const [right, bottom] = [left + width / view.scale, top + height / view.scale];
  return streets.filter((one) => one.right >= left && one.left <= right && one.bottom >= top && one.top <= bottom);
}
