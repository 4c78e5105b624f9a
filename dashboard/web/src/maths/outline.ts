// SPDX-License-Identifier: Apache-2.0
import type { TraversalMap } from '../api/types';
import type { Point, View } from './geometry';

// A map has some frames of a long traversal. In between a route is straight; where that shows, the page asks for more of them.

/** Returns the last place in `index`, which ascends, of a frame that is at most `frame`; -1 before the first. */
export function placeOf(index: readonly number[], frame: number): number {
  let low = -1;
  let high = index.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((index[middle] as number) <= frame) low = middle;
    else high = middle;
  }
  return low;
}

/** Returns what a frame has, `mixed` of those before and after it by its part of the way; null where one is unknown. */
function between<T>(index: readonly number[], values: readonly (T | null)[], frame: number, mixed: (a: T, b: T, part: number) => T): T | null {
  const i = placeOf(index, frame);
  const [before, from] = [values[i] ?? null, index[i]];
  if (before === null || from === undefined || from === frame) return before;
  const [after, to] = [values[i + 1] ?? null, index[i + 1]];
  return after === null || to === undefined ? null : mixed(before, after, (frame - from) / (to - from));
}

const straight = (a: number, b: number, part: number): number => a + (b - a) * part;

/** Returns the value of a frame, on a straight line between those before and after it; null where one is unknown. */
export function valueAt(index: readonly number[], values: readonly (number | null)[], frame: number): number | null {
  return between(index, values, frame, straight);
}

export function pointAt(index: readonly number[], points: readonly (Point | null)[], frame: number): Point | null {
  return between(index, points, frame, (a, b, part) => ({ x: straight(a.x, b.x, part), y: straight(a.y, b.y, part) }));
}

/** Returns the points of the frames `first` to `last`, with those two. */
export function pointsBetween(index: readonly number[], points: readonly (Point | null)[], first: number, last: number): (Point | null)[] {
  if (last < first) return [];
  return [pointAt(index, points, first), ...points.slice(placeOf(index, first) + 1, placeOf(index, last) + 1), pointAt(index, points, last)];
}

/** Returns the map with a part of it in more detail. */
export function refined(map: TraversalMap, detail: TraversalMap | null): TraversalMap {
  const [first, last] = [detail?.index[0], detail?.index[detail.index.length - 1]];
  if (!detail || detail.hash !== map.hash || first === undefined || last === undefined) return map;
  const from = placeOf(map.index, first - 1) + 1;
  const to = placeOf(map.index, last) + 1;
  const joined = <T>(all: readonly T[] | null, part: readonly T[] | null): T[] | null =>
    all && [...all.slice(0, from), ...(part ?? detail.index.map(() => null as T)), ...all.slice(to)];
  return {
    ...map,
    index: joined(map.index, detail.index) as number[],
    position: joined(map.position, detail.position),
    latitude: joined(map.latitude, detail.latitude),
    longitude: joined(map.longitude, detail.longitude),
  };
}

/**
 * Returns the part of the traversal on the screen, as parameters of a map's address, when the map has too few frames of it.
 * It stays the same while the view moves a little.
 */
export function detailOf({ index, frames }: Pick<TraversalMap, 'index' | 'frames'>, points: readonly (Point | null)[], view: View, width: number, height: number): string | null {
  const [left, top] = [-view.x / view.scale, -view.y / view.scale];
  const [right, bottom] = [left + width / view.scale, top + height / view.scale];
  let [first, last, there] = [-1, -1, 0];
  points.forEach((a, i) => {
    const b = points[i + 1];
    if (!a || !b || Math.max(a.x, b.x) < left || Math.min(a.x, b.x) > right || Math.max(a.y, b.y) < top || Math.min(a.y, b.y) > bottom) return;
    if (there++ === 0) first = index[i] as number;
    last = index[i + 1] as number;
  });
  if (last - first <= there || there > width) return null; // all frames, or more of them than pixels
  const size = 2 ** Math.ceil(Math.log2(last - first + 1));
  if (2 * size > frames) return null; // that would be the map again
  const from = Math.floor(first / size) * size;
  return `?first=${from}&last=${from + 2 * size - 1}`;
}
