// SPDX-License-Identifier: Apache-2.0
import type { CurveAnswer, Run } from '../api/types';
import { smooth } from './ema';
import type { XAxis } from './rows';
import type { Curve } from './seeds';

/** Returns whether a program logged the run, or it was imported: its figures have free names. */
export const isLogged = (run: Partial<Pick<Run, 'source'>>): boolean => Boolean(run.source);

/** Returns what the API calls an axis of a logged run, which knows no episodes. */
export function loggedAxis(x: XAxis): 'steps' | 'wall' | 'records' {
  return x === 'wall' ? 'wall' : x === 'update' ? 'records' : 'steps';
}

/** Returns a curve in the order of x, smoothed by points; of points with equal x the last. */
export function loggedCurve({ columns, total }: CurveAnswer, smoothing: number): Curve {
  const between = total / Math.max(columns.x.length, 1); // points, on average, where the curve is decimated
  const order = columns.x.map((_, i) => i).filter((i) => columns.x[i] !== null);
  order.sort((a, b) => (columns.x[a] ?? 0) - (columns.x[b] ?? 0) || a - b);
  const last = order.filter((i, at) => columns.x[i] !== columns.x[order[at + 1] ?? -1]);
  const y = last.map((i) => columns.value[i] ?? null);
  return { x: last.map((i) => columns.x[i] ?? 0), y: smooth(y, last.map((_, at) => at * between), smoothing) };
}
