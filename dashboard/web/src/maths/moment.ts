// SPDX-License-Identifier: Apache-2.0
import type { Evaluation, RunMoment } from '../api/types';
import { isControl } from './evaluations';
import { duration, integer, short } from './format';
import { axis, type Rows, type XAxis } from './rows';
import { lowerBound } from './seeds';

/** Returns how far a run was at a point of an axis: the figures of the nearest update. Returns null if there is none. */
export function momentAt(rows: Rows, x: XAxis, at: number): RunMoment | null {
  if (rows.length === 0) return null;
  const along = axis(rows, x);
  const after = Math.min(lowerBound(along, at), along.length - 1);
  const before = Math.max(after - 1, 0);
  const row = at - (along[before] as number) < (along[after] as number) - at ? before : after;
  const value = (name: XAxis): number => axis(rows, name)[row] ?? 0;
  return { update: value('update'), steps: value('steps'), episodes: value('episodes'), wall: value('wall') };
}

/** Writes a point of an axis: "51.2k steps", "12.3 s". */
export function momentName(x: XAxis, at: number): string {
  return x === 'wall' ? duration(at) : `${short(at)} ${x === 'update' ? 'updates' : x}`;
}

/** Describes a moment on all axes. */
export function momentText({ update, steps, episodes, wall }: RunMoment): string {
  return `update ${integer(update)} · ${integer(steps)} steps · ${integer(episodes)} episodes · ${duration(wall)} of training`;
}

/** Writes a point of an axis as short as it can be without becoming another one: counts as integers, seconds with milliseconds. */
export function pointText(x: XAxis, at: number): string {
  return x === 'wall' ? String(Number(at.toFixed(3))) : String(Math.round(at));
}

/** Returns the agent's newest evaluation on a traversal up to an update; null for none. Without an update, the newest of all. */
export function evaluationUntil(list: readonly Evaluation[], traversal: string | null, update: number | null): Evaluation | null {
  const own = list.filter((one) => !isControl(one) && !one.shuffled && (traversal === null || one.traversal === traversal) && (update === null || one.update <= update));
  return own.reduce<Evaluation | null>((best, one) => (best === null || one.update > best.update ? one : best), null);
}
