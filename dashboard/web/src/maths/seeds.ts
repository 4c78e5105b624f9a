// SPDX-License-Identifier: Apache-2.0
/** A curve: x ascending, y null where unknown. */
export interface Curve {
  x: readonly number[];
  y: readonly (number | null)[];
}

/** Part of an axis. */
export interface Range {
  from: number;
  to: number;
}

/** Mean and spread of several curves, on a grid of their own. */
export interface Band {
  x: number[];
  mean: (number | null)[];
  low: (number | null)[];
  high: (number | null)[];
  /** How many curves have reached each x. */
  count: number[];
}

/** Returns the value at `x`, interpolated linearly; null outside and in gaps. */
export function valueAt(curve: Curve, x: number): number | null {
  const { x: xs, y: ys } = curve;
  const after = lowerBound(xs, x);
  if (after >= xs.length) return null;
  const right = ys[after] ?? null;
  if (xs[after] === x) return right;
  if (after === 0) return null;
  const left = ys[after - 1] ?? null;
  if (left === null || right === null) return null;
  const from = xs[after - 1] as number;
  return left + ((right - left) * (x - from)) / ((xs[after] as number) - from);
}

/** Index of the first of `sorted` that is not less than `x`. */
export function lowerBound(sorted: readonly number[], x: number): number {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((sorted[middle] as number) < x) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * Mean, lowest and highest of curves at `points` places from the least x to the greatest, or of that what lies in `range`. They
 * begin where every curve has begun, as a mean of the first to begin jumps with each that joins. At each place those curves
 * count that have a value there; one that ended earlier does not.
 */
export function aggregate(curves: readonly Curve[], points = 400, range: Range | null = null): Band {
  const band: Band = { x: [], mean: [], low: [], high: [], count: [] };
  const there = curves.filter((curve) => curve.x.length > 0);
  if (there.length === 0) return band;
  const first = Math.max(range?.from ?? -Infinity, Math.min(...there.map((curve) => curve.x[0] as number)));
  const last = Math.min(range?.to ?? Infinity, Math.max(...there.map((curve) => curve.x[curve.x.length - 1] as number)));
  const begun = Math.max(...there.map((curve) => curve.x[curve.y.findIndex((value) => value !== null)] ?? -Infinity));
  const rows = last > first ? points : 1;
  for (let i = 0; i < rows; ++i) {
    // The ends are exact, so that rounding excludes no curve there.
    const x = i === 0 ? first : i === rows - 1 ? last : first + ((last - first) * i) / (rows - 1);
    const values = x < begun ? [] : known(there.map((curve) => valueAt(curve, x)));
    band.x.push(x);
    band.count.push(values.length);
    band.mean.push(values.length ? mean(values) : null);
    band.low.push(values.length ? Math.min(...values) : null);
    band.high.push(values.length ? Math.max(...values) : null);
  }
  return band;
}

/** Returns the values that are known. */
export function known(values: readonly (number | null | undefined)[]): number[] {
  return values.filter((value): value is number => typeof value === 'number' && Number.isFinite(value));
}

export function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/** Sample standard deviation; null of fewer than two values. */
export function deviation(values: readonly number[]): number | null {
  if (values.length < 2) return null;
  const middle = mean(values);
  return Math.sqrt(values.reduce((sum, value) => sum + (value - middle) ** 2, 0) / (values.length - 1));
}

export function median(values: readonly number[]): number | null {
  if (values.length === 0) return null;
  const sorted = [...values].sort((a, b) => a - b);
  const half = sorted.length >> 1;
  return sorted.length % 2 ? (sorted[half] as number) : ((sorted[half - 1] as number) + (sorted[half] as number)) / 2;
}
