// SPDX-License-Identifier: Apache-2.0
/** A point of the plane, x to the right, y down as on a screen. */
export interface Point {
  x: number;
  y: number;
}

const EARTH = 6_371_008.8; // mean radius, metres
const RAD = Math.PI / 180;

/**
 * Places in metres east and north of their middle, north up (y falls to the north, as screens count): equirectangular about
 * the middle latitude, right to a few centimetres over some kilometres. Null where a place is unknown; null for all when
 * fewer than two places are known.
 */
export function project(
  latitude: readonly (number | null)[],
  longitude: readonly (number | null)[],
  about: Origin | null = originOf(latitude, longitude),
): (Point | null)[] | null {
  if (!about) return null;
  const { lat0, lon0 } = about;
  return latitude.map((lat, i) => {
    const lon = longitude[i] ?? null;
    if (lat === null || lon === null) return null;
    const turned = lon + 360 * Math.round((lon0 - lon) / 360); // a road may cross longitude 180
    return { x: (turned - lon0) * RAD * EARTH * Math.cos(lat0 * RAD), y: -(lat - lat0) * RAD * EARTH };
  });
}

interface Origin {
  lat0: number;
  lon0: number;
}

/** Returns the middle of the places, in degrees; null when fewer than two are known. */
export function originOf(latitude: readonly (number | null)[], longitude: readonly (number | null)[]): Origin | null {
  const known = latitude
    .map((lat, i) => [lat, longitude[i] ?? null] as const)
    .filter((pair): pair is readonly [number, number] => pair[0] !== null && pair[1] !== null);
  if (known.length < 2) return null;
  const lats = known.map((pair) => pair[0]);
  const first = known[0]?.[1] ?? 0;
  const lons = known.map((pair) => pair[1] + 360 * Math.round((first - pair[1]) / 360));
  return { lat0: (least(lats) + greatest(lats)) / 2, lon0: (least(lons) + greatest(lons)) / 2 };
}

/** Returns the smallest of the values; unlike Math.min, however many there are. */
export function least(values: readonly number[]): number {
  return values.reduce((a, b) => Math.min(a, b), Infinity);
}
export function greatest(values: readonly number[]): number {
  return values.reduce((a, b) => Math.max(a, b), -Infinity);
}

/** From the plane to the screen: screen = plane * scale + offset. */
export interface View {
  scale: number;
  x: number;
  y: number;
}

/** The view that shows all points, centred, with `margin` pixels round them. */
export function fit(points: readonly (Point | null)[], width: number, height: number, margin: number): View {
  const there = points.filter((point): point is Point => point !== null);
  if (there.length === 0) return { scale: 1, x: width / 2, y: height / 2 };
  const left = least(there.map((p) => p.x));
  const right = greatest(there.map((p) => p.x));
  const top = least(there.map((p) => p.y));
  const bottom = greatest(there.map((p) => p.y));
  const wide = Math.max(width - 2 * margin, 1);
  const high = Math.max(height - 2 * margin, 1);
  let scale = Math.min(wide / (right - left), high / (bottom - top));
  if (!Number.isFinite(scale)) scale = 1;
  return { scale, x: width / 2 - (scale * (left + right)) / 2, y: height / 2 - (scale * (top + bottom)) / 2 };
}

export function toScreen(view: View, point: Point): Point {
  return { x: point.x * view.scale + view.x, y: point.y * view.scale + view.y };
}

/** The points as the data of an SVG path, with a gap where a point is unknown. */
export function pathOf(points: readonly (Point | null)[]): string {
  return points.map((point, i) => (point ? `${points[i - 1] ? 'L' : 'M'}${point.x.toFixed(2)} ${point.y.toFixed(2)}` : '')).join('');
}

/** The view after zooming by `factor` about a point of the screen, which stays where it is. */
export function zoomAt(view: View, about: Point, factor: number): View {
  return {
    scale: view.scale * factor,
    x: about.x - (about.x - view.x) * factor,
    y: about.y - (about.y - view.y) * factor,
  };
}

/** Greatest of 1, 2, 5 times a power of ten that is at most `most`. */
export function niceBelow(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  const times = most / power;
  return (times >= 5 ? 5 : times >= 2 ? 2 : 1) * power;
}

/** A scale bar: at most `width` pixels long, its length in the plane a round number. */
export function scaleBar(view: View, width: number): { length: number; pixels: number } {
  const length = niceBelow(width / view.scale);
  return { length, pixels: length * view.scale };
}

/** Round numbers from `from` to `to`, about `count` of them, whole ones. */
export function ticks(from: number, to: number, count: number): number[] {
  const step = Math.max(1, niceBelow(Math.max((to - from) / Math.max(count, 1), 1) * 1.999));
  const result: number[] = [];
  for (let at = Math.ceil(from / step) * step; at <= to; at += step) result.push(at);
  return result;
}

/** Index of the point nearest to `to`, within `within` pixels; -1 when none is. */
export function nearest(points: readonly (Point | null)[], to: Point, within: number): number {
  let best = -1;
  let least = within * within;
  points.forEach((point, i) => {
    if (!point) return;
    const distance = (point.x - to.x) ** 2 + (point.y - to.y) ** 2;
    if (distance <= least) {
      least = distance;
      best = i;
    }
  });
  return best;
}
