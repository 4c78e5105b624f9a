// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import uPlot from 'uplot';
import { csv } from '../maths/csv';
import type { Line } from '../maths/curves';
import { short, significant } from '../maths/format';
import { valueAt, type Curve } from '../maths/seeds';
import type { ChartProps, Reference } from './chart';
import { Table, type Column } from './table';

const TABLE_ROWS = 40;

/** Puts curves on one x axis: every x of any of them. */
export function align(curves: readonly Curve[]): uPlot.AlignedData {
  return uPlot.join(curves.map(({ x, y }) => [x, y] as unknown as uPlot.AlignedData));
}

/** Returns what is drawn as a table, one row per x: a column per line, two more per spread, one per reference. */
export function chartCsv(xLabel: string, lines: readonly Line[], references: readonly Reference[]): string {
  const curves = lines.flatMap(({ label, x, y, band }) => [
    { label, x, y },
    ...(band ? [{ label: `${label} (lowest)`, x, y: band.low }, { label: `${label} (highest)`, x, y: band.high }] : []),
  ]);
  const [x, ...columns] = align(curves);
  return csv(
    [xLabel, ...curves.map(({ label }) => label), ...references.map(({ label }) => label)],
    Array.from(x, (value, row) => [value, ...columns.map((column) => column[row]), ...references.map((reference) => reference.value)]),
  );
}

/** Shows the lines as a table: equally spaced places along the x axis. */
export function ChartTable({ title, xLabel, lines, references, zoom, format = significant, xFormat = short }: ChartProps & {
  references: readonly Reference[];
}): JSX.Element {
  const first = zoom?.from ?? Math.min(...lines.map((line) => line.x[0] ?? Infinity));
  const last = zoom?.to ?? Math.max(...lines.map((line) => line.x[line.x.length - 1] ?? -Infinity));
  const count = first === last ? 1 : TABLE_ROWS;
  const rows = Array.from({ length: count }, (_, i) => (i === count - 1 ? last : first + ((last - first) * i) / (count - 1)));
  const at = (x: number, y: Curve['y'], line: Line): string => format(valueAt({ x: line.x, y }, x));
  const column = (key: string, label: string, show: (x: number) => string): Column<number> => ({ key, label, number: true, show });
  return (
    <>
      <Table
        caption={`${title} over ${xLabel}`}
        rows={rows}
        rowKey={(_, i) => i}
        columns={[
          column('x', xLabel, xFormat),
          ...lines.flatMap((line) => {
            const { key, label, y, band } = line;
            const own = column(key, label, (x) => at(x, y, line));
            if (!band) return [own];
            return [own, column(`${key} spread`, 'lowest to highest', (x) => `${at(x, band.low, line)} to ${at(x, band.high, line)}`)];
          }),
          ...references.map(({ label, value }) => column(`reference ${label}`, label, () => format(value))),
        ]}
      />
      <p class="hint">{TABLE_ROWS} places along the axis, interpolated linearly. The CSV has every point.</p>
    </>
  );
}
