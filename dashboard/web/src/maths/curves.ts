// SPDX-License-Identifier: Apache-2.0
import { aggregate, type Curve, type Range } from './seeds';
import { axis, metric, type Rows, type XAxis } from './rows';

export type Display = 'mean' | 'runs' | 'both';

export interface GroupRows {
  key: string;
  label: string;
  colour: string;
  runs: { id: string; label: string; colour: string; rows: Rows }[];
}

/** A line of a chart. */
export interface Line extends Curve {
  key: string;
  label: string;
  /** A colour of the design system: "series-1". */
  colour: string;
  faint?: boolean;
  /** Spread around the line, drawn as an area. */
  band?: { low: readonly (number | null)[]; high: readonly (number | null)[] };
}

export interface CurveOptions {
  metric: string;
  x: XAxis;
  smoothing: number;
  display: Display;
  /** IDs of runs whose own lines are not drawn. They still count in the mean. */
  hidden: ReadonlySet<string>;
  /** The visible part of the axis; null: all of it. */
  range: Range | null;
}

/**
 * Exponential moving average, debiased: the weights of what there is so far add up to 1, so that the start is not drawn
 * towards zero. `smoothing` is the weight that one update keeps at the next (0: none; the paper's curves have 0.9). Where
 * rows are missing (a decimated series) the weight decays by the updates between, `at` (ascending). Gaps (null) stay gaps.
 */
export function smooth(values: readonly (number | null)[], at: readonly number[], smoothing: number): (number | null)[] {
  if (smoothing <= 0) return values.slice();
  let sum = 0;
  let weight = 0;
  let last: number | null = null;
  return values.map((value, i) => {
    if (value === null || Number.isNaN(value)) return null;
    const now = at[i] ?? i;
    const decay = last === null ? 0 : smoothing ** Math.max(now - last, 0);
    last = now;
    sum = sum * decay + value * (1 - smoothing);
    weight = weight * decay + (1 - smoothing);
    return sum / weight;
  });
}

export function curveOf(rows: Rows, options: Pick<CurveOptions, 'metric' | 'x' | 'smoothing'>): Curve {
  const at = axis(rows, options.x);
  return increasing({ x: at, y: smooth(metric(rows, options.metric), axis(rows, 'update'), options.smoothing) });
}

/** Keeps the last of points with equal x: updates without a new episode have the same count of episodes. */
function increasing(curve: Curve): Curve {
  const x: number[] = [];
  const y: (number | null)[] = [];
  curve.x.forEach((value, i) => {
    if (x.length > 0 && x[x.length - 1] === value) y[y.length - 1] = curve.y[i] ?? null;
    else {
      x.push(value);
      y.push(curve.y[i] ?? null);
    }
  });
  return { x, y };
}

/** Returns the lines of one chart. A group's mean and spread include all of its runs, also hidden ones. */
export function linesOf(groups: readonly GroupRows[], options: CurveOptions): Line[] {
  const lines: Line[] = [];
  for (const group of groups) {
    const curves = group.runs.map((run) => curveOf(run.rows, options));
    const alone = group.runs.length === 1;
    if (options.display !== 'mean' || alone) {
      group.runs.forEach((run, i) => {
        const curve = curves[i];
        if (!curve || options.hidden.has(run.id)) return;
        const label = alone ? group.label : `${group.label}, ${run.label}`;
        const colour = options.display === 'runs' ? run.colour : group.colour;
        const faint = options.display === 'both' && !alone;
        if (options.smoothing > 0 && !faint) {
          const raw = curveOf(run.rows, { ...options, smoothing: 0 });
          lines.push({ ...raw, key: `raw ${run.id}`, label: `${label}, not smoothed`, colour, faint: true });
        }
        lines.push({ ...curve, key: run.id, label, colour, faint });
      });
    }
    if (options.display !== 'runs' && !alone) {
      const band = aggregate(curves, 400, options.range);
      const count = Math.max(0, ...band.count);
      lines.push({
        x: band.x,
        y: band.mean,
        band: { low: band.low, high: band.high },
        key: `mean ${group.key}`,
        label: `${group.label}, mean of ${count}`,
        colour: group.colour,
      });
    }
  }
  return lines;
}
