// SPDX-License-Identifier: Apache-2.0
import { signal, type Signal } from '@preact/signals';
import { useEffect, useMemo } from 'preact/hooks';
import { getJson, runPath } from '../api/client';
import { trainingColumns } from '../api/frame';
import { live } from '../api/live';
import { TRAINING_COLUMNS } from '../api/training_figures';
import type { Run, TrainingAnswer } from '../api/types';
import { append, noRows, rowsOf, type Rows, type XAxis } from '../maths/rows';
import type { Range } from '../maths/seeds';
import { failure, useJsons } from './resource';

export interface Training {
  state: 'loading' | 'ready' | 'failed';
  error: string;
  rows: Rows;
  /** Grows with each change of `rows`, which changes in place. */
  version: number;
}

const POINTS = 2000;
const REDRAW = 500; // milliseconds between two redraws because of live rows
const PATIENCE = 2000; // milliseconds before missing rows are fetched, as the store lags slightly behind live rows

/** The training figures of one run while a component shows them: fetched once, then live. */
class Series {
  readonly value: Signal<Training> = signal({ state: 'loading', error: '', rows: noRows(), version: 0 });
  users = 0;
  private stop: (() => void)[] = [];
  private timer: ReturnType<typeof setTimeout> | undefined;
  private reload: ReturnType<typeof setTimeout> | undefined;
  private loading = false;
  private stale = false; // rows are missing between others, or there are so many that the server should decimate them
  private pending: ReadonlyMap<string, Float64Array>[] = [];

  constructor(private readonly id: string) {}

  start(): void {
    this.stop = [
      live.watch(`training:${this.id}`, (frame) => this.take(trainingColumns(frame))),
      live.onBack(() => void this.load()),
    ];
    void this.load();
  }

  end(): void {
    this.stop.forEach((stop) => stop());
    clearTimeout(this.timer);
    clearTimeout(this.reload);
    this.timer = this.reload = undefined;
  }

  private async load(): Promise<void> {
    if (this.loading) return;
    this.loading = true;
    this.stale = false;
    this.pending = [];
    try {
      const columns = TRAINING_COLUMNS.join(',');
      const answer = await getJson<TrainingAnswer>(
        runPath(this.id, `/training?columns=${columns}&points=${POINTS}&x=updates`),
      );
      const rows = rowsOf(answer);
      this.pending.forEach((news) => append(rows, news)); // rows that arrived while the answer was on its way
      this.value.value = { state: 'ready', error: '', rows, version: this.value.value.version + 1 };
    } catch (error) {
      if (this.value.value.state !== 'ready')
        this.value.value = { ...this.value.value, state: 'failed', error: failure(error).error };
    }
    this.loading = false;
    this.catchUp();
  }

  /** Fetches the rows again, soon, if they are stale, or the store has newer ones: these were told before this page listened. */
  catchUp(): void {
    if (this.users === 0 || !this.behind()) return;
    this.reload ??= setTimeout(() => {
      this.reload = undefined;
      if (this.behind()) void this.load();
    }, PATIENCE);
  }

  private behind(): boolean {
    const newest = this.value.peek().rows.columns.steps.at(-1) ?? -1;
    return this.stale || newest < (stored.get(this.id) ?? -1);
  }

  private take(columns: ReadonlyMap<string, Float64Array>): void {
    if (this.loading) {
      this.pending.push(columns);
      return;
    }
    const { rows } = this.value.value;
    if (!append(rows, columns) || rows.length > 3 * POINTS) {
      this.stale = true;
      this.catchUp();
    }
    this.timer ??= setTimeout(() => {
      this.timer = undefined;
      const old = this.value.value;
      this.value.value = { ...old, state: 'ready', version: old.version + 1 };
    }, REDRAW);
  }
}

/** Fetches the rows of these runs in a range of an axis. Returns those that have arrived. */
export function useDetail(ids: readonly string[], detail: (Range & { x: XAxis }) | null): Map<string, Rows> {
  const query = `columns=${TRAINING_COLUMNS.join(',')}&points=${POINTS}&x=${detail?.x}&from=${detail?.from}&to=${detail?.to}`;
  const paths = detail ? ids.map((id) => runPath(id, `/training?${query}`)) : [];
  const answers = useJsons<TrainingAnswer>(paths);
  const key = [...answers.values()].map((one) => one.state).join();
  return useMemo(() => {
    const rows = new Map<string, Rows>();
    if (detail)
      ids.forEach((id, i) => {
        const answer = answers.get(paths[i] ?? '');
        if (answer?.state === 'ready' && answer.value.columns.x?.length) rows.set(id, rowsOf(answer.value));
      });
    return rows;
  }, [paths.join('\n'), key]);
}

const all = new Map<string, Series>();
const stored = new Map<string, number>(); // steps of a run up to its newest row in the store

function seriesOf(id: string): Series {
  let series = all.get(id);
  if (!series) all.set(id, (series = new Series(id)));
  return series;
}

// Series that no component shows are kept for a while, so that they reappear at once.
const MOST_KEPT = 32;

function forget(): void {
  for (const [id, series] of all) {
    if (all.size <= MOST_KEPT) return;
    if (series.users === 0) all.delete(id);
  }
}

/** Fetches the figures of those runs that have newer ones in the store than are shown. */
export function heedRuns(runs: readonly Run[]): void {
  stored.clear();
  for (const { id, steps } of runs) if (steps !== null) stored.set(id, steps);
  all.forEach((series) => series.catchUp());
}

/** Returns the training figures of these runs, live while the component is mounted. */
export function useTraining(ids: readonly string[]): Map<string, Training> {
  const key = ids.join('\n');
  useEffect(() => {
    const mine = ids.map(seriesOf);
    for (const series of mine) if (series.users++ === 0) series.start();
    return () => {
      for (const series of mine) if (--series.users === 0) series.end();
      forget();
    };
  }, [key]);
  return new Map(ids.map((id) => [id, seriesOf(id).value.value]));
}
