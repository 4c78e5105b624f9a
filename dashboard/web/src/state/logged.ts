// SPDX-License-Identifier: Apache-2.0
import { useMemo } from 'preact/hooks';
import { runPath } from '../api/client';
import type { CurveAnswer, MetricsAnswer, Run } from '../api/types';
import { loggedAxis, loggedCurve } from '../maths/logged';
import type { Line } from '../maths/curves';
import type { XAxis } from '../maths/rows';
import type { Range } from '../maths/seeds';
import { useJsons, valueOf } from './resource';
import { now } from './shared';

const POINTS = 1000; // more than a chart has pixels
const PERIOD = 3000; // milliseconds between two fetches of what a program still logs

/** Changes when there may be news of these runs. */
function newsOf(runs: readonly Run[]): string {
  return runs.map((run) => (run.state === 'running' ? Math.floor(now.value / PERIOD) : run.updates)).join();
}

/** Returns the names of the metrics that any of these logged runs has, sorted; null while they are fetched for the first time. */
export function useMetrics(runs: readonly Run[]): string[] | null {
  const answers = [...useJsons<MetricsAnswer>(runs.map((run) => runPath(run.id, '/metrics')), newsOf(runs)).values()];
  if (answers.some((answer) => answer.state === 'loading')) return null;
  return [...new Set(answers.flatMap((answer) => valueOf(answer)?.metrics.map(({ name }) => name) ?? []))].sort();
}

/** A logged run that is drawn. */
export interface Drawn {
  run: Run;
  label: string;
  colour: string;
}

/** Returns the curves of each metric, one line a run that has it. */
export function useLoggedLines(drawn: readonly Drawn[], metrics: readonly string[], options: { x: XAxis; smoothing: number; zoom?: Range | null }): Map<string, Line[]> {
  const { x, smoothing, zoom } = options;
  const pathOf = (run: Run, metric: string): string =>
    runPath(run.id, `/curve?${new URLSearchParams({ metric, x: loggedAxis(x), points: String(POINTS), ...(zoom && { from: String(zoom.from), to: String(zoom.to) }) }).toString()}`);
  const runs = drawn.map(({ run }) => run);
  const paths = metrics.flatMap((metric) => runs.map((run) => pathOf(run, metric)));
  const news = newsOf(runs);
  const answers = useJsons<CurveAnswer>(paths, news);
  const states = [...answers.values()].map((one) => one.state).join();
  return useMemo(() => {
    const linesOf = (metric: string): Line[] =>
      drawn.flatMap(({ run, label, colour }) => {
        const answer = answers.get(pathOf(run, metric));
        const value = answer && valueOf(answer);
        return value ? [{ key: run.id, label, colour, ...loggedCurve(value, smoothing) }] : [];
      });
    return new Map(metrics.map((metric) => [metric, linesOf(metric)]));
  }, [paths.join('\n'), states, news, smoothing, drawn.map(({ colour }) => colour).join()]);
}
