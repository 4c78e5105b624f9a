// SPDX-License-Identifier: Apache-2.0
import type { Curve } from './seeds';

/** Puts several curves on one x axis: every x of any of them, null where a curve has none. */
export function align(curves: readonly Curve[]): { x: number[]; columns: (number | null)[][] } {
  const only = curves[0];
  if (curves.length === 1 && only) return { x: only.x.slice(), columns: [only.y.slice()] };
  const x = [...new Set(curves.flatMap((curve) => curve.x))].sort((a, b) => a - b);
  const row = new Map(x.map((value, i) => [value, i]));
  const columns = curves.map((curve) => {
    const column = new Array<number | null>(x.length).fill(null);
    curve.x.forEach((value, i) => (column[row.get(value) as number] = curve.y[i] ?? null));
    return column;
  });
  return { x, columns };
}
