// SPDX-License-Identifier: Apache-2.0
import { TRAINING_COLUMNS } from '../api/training_figures';
import type { TrainingAnswer } from '../api/types';

type Column = (number | null)[];

/** Columns of a run's training, one number a row, rows in the order of updates. */
export interface Rows {
  length: number;
  decimated: boolean;
  columns: { [name: string]: Column } & Record<XAxis, Column>;
}

export function noRows(): Rows {
  const columns = Object.fromEntries(TRAINING_COLUMNS.map((name) => [name, []])) as unknown as Rows['columns'];
  return { length: 0, decimated: false, columns };
}

export function rowsOf(answer: TrainingAnswer): Rows {
  const rows = noRows();
  rows.decimated = answer.decimated;
  rows.length = answer.columns.x?.length ?? 0;
  for (const name of TRAINING_COLUMNS)
    rows.columns[name] = answer.columns[name] ?? new Array<number | null>(rows.length).fill(null);
  return rows;
}

/**
 * Appends live updates. A run resumed from an older checkpoint repeats some updates: the old ones are replaced. Returns false
 * when updates in between are missing and must be fetched.
 */
export function append(rows: Rows, columns: ReadonlyMap<string, ArrayLike<number>>): boolean {
  const updates = columns.get('update');
  const first = updates?.[0];
  if (!updates || first === undefined) return true;
  let keep = rows.length;
  while (keep > 0 && (rows.columns.update[keep - 1] ?? -Infinity) >= first) --keep;
  const before = keep > 0 ? rows.columns.update[keep - 1] : 0;
  const joins = (before ?? 0) + 1 >= first;
  for (const name of TRAINING_COLUMNS) {
    const column = (rows.columns[name] ??= []);
    column.length = keep;
    const news = columns.get(name);
    for (let i = 0; i < updates.length; ++i) {
      const value = news?.[i];
      column.push(value === undefined || Number.isNaN(value) ? null : value);
    }
  }
  rows.length = keep + updates.length;
  return joins;
}

export type XAxis = 'episodes' | 'steps' | 'wall' | 'update';

/** Returns a column as an axis. An unknown value repeats the one before, so that the axis stays ascending. */
export function axis(rows: Rows, x: XAxis): number[] {
  let last = 0;
  return rows.columns[x].map((value) => (last = Math.max(last, value ?? last)));
}

/** Means over the last 100 episodes. Those of fewer are of the shortest tasks, as these end first. */
const MEANS = ['reward', 'spl', 'episode_length'];
const SETTLED = 100;

/** Returns a figure that can be drawn. Means over 100 episodes are null until so many have ended. */
export function metric(rows: Rows, key: string): Column {
  const column = rows.columns[key] ?? [];
  if (!MEANS.includes(key)) return column;
  const episodes = axis(rows, 'episodes');
  return column.map((value, i) => ((episodes[i] ?? 0) < SETTLED ? null : value));
}

/** Returns the last known value of a column. */
export function latest(rows: Rows, key: string): number | null {
  return metric(rows, key).findLast((value) => value !== null) ?? null;
}
