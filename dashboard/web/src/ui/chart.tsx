// SPDX-License-Identifier: Apache-2.0
import { render, type JSX } from 'preact';
import { useEffect, useMemo, useRef } from 'preact/hooks';
import uPlot from 'uplot';
import { csv, download, fileName } from '../maths/csv';
import type { Line } from '../maths/curves';
import { short, significant } from '../maths/format';
import { lowerBound, type Curve, type Range } from '../maths/seeds';
import { colour as colourOf, isDark } from '../state/theme';
import { Card, Empty, IconButton, Swatch } from './basics';
import { useSize, useVisible } from './use';

/** A horizontal line to compare with. */
export interface Reference {
  label: string;
  value: number;
}

export interface ChartProps {
  title: string;
  hint?: string;
  /** What the axes show, with the unit unless the numbers have it. */
  xLabel: string;
  yLabel: string;
  lines: readonly Line[];
  references?: readonly Reference[];
  /** Part of the names of saved files: the page or the run. */
  name: string;
  format?: (value: number | null) => string;
  xFormat?: (value: number) => string;
  height?: number;
  legend?: boolean;
  /** Part of the x axis to show. `onZoom` is called when the user selects a part, or all of it (null). */
  zoom?: Range | null;
  onZoom?: (range: Range | null) => void;
  /** Charts with the same name share one cursor. */
  sync?: string;
  /** The greatest value that there can be: no line and no label of the y axis lies above it. */
  max?: number | undefined;
  empty?: string;
}

/** Puts curves on one x axis: every x of any of them. */
function align(curves: readonly Curve[]): uPlot.AlignedData {
  return uPlot.join(curves.map(({ x, y }) => [x, y] as unknown as uPlot.AlignedData));
}

/** Returns what is drawn as CSV, one row per x: a column per line, two more per spread, one per reference. */
function chartCsv(xLabel: string, lines: readonly Line[], references: readonly Reference[]): string {
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

/** Shows lines over x as a chart, and saves them as CSV. */
export function Chart(props: ChartProps): JSX.Element {
  const { title, hint, xLabel, lines, references = [], name, zoom = null } = props;
  const there = lines.filter((line) => line.y.some((value) => value !== null));
  const save = (): void => download(`${fileName(`${name} ${title}`)}.csv`, chartCsv(xLabel, there, references));
  return (
    <Card
      title={title}
      hint={hint}
      class="chart-card"
      actions={
        <>
          {zoom && props.onZoom && (
            <button type="button" onClick={() => props.onZoom?.(null)}>
              Whole range
            </button>
          )}
          <IconButton icon="save" label={`Download ${title} as CSV`} disabled={there.length === 0} onClick={save} />
        </>
      }
    >
      {there.length === 0 ? (
        <Empty title={props.empty ?? 'No values yet'} />
      ) : (
        <>
          <Plot {...props} lines={there} references={references} zoom={zoom} />
          {props.legend && <Legend lines={there} format={props.format ?? significant} />}
          {references.length > 0 && <References list={references} format={props.format ?? significant} />}
        </>
      )}
    </Card>
  );
}

function Legend({ lines, format }: { lines: readonly Line[]; format: (value: number | null) => string }): JSX.Element {
  return (
    <ul class="legend">
      {lines
        .filter((line) => !line.faint)
        .map((line) => (
          <li key={line.key} class="row">
            <Swatch colour={line.colour} />
            {line.label}
            <span class="number">{format(lastOf(line))}</span>
          </li>
        ))}
    </ul>
  );
}

const lastOf = (line: Line): number | null => line.y.findLast((value) => value !== null) ?? null;

type PlotProps = ChartProps & { references: readonly Reference[]; zoom: Range | null };

// What a plot reads while it draws. It outlives many renderings.
interface Current extends PlotProps {
  data: uPlot.AlignedData;
}

function Plot(props: PlotProps): JSX.Element {
  const { title, xLabel, lines, references, zoom, format = significant, height = 220 } = props;
  const [room, size] = useSize<HTMLDivElement>();
  const visible = useVisible(room);
  const plot = useRef<uPlot | null>(null);
  const current = useRef<Current | null>(null);
  const data = useMemo(() => (visible ? dataOf(lines) : null), [lines, visible]);
  const structure = JSON.stringify([
    isDark.value,
    height,
    props.sync,
    xLabel,
    props.yLabel,
    lines.map((line) => [line.key, line.colour, line.faint, line.band !== undefined]),
  ]);

  useEffect(() => {
    if (data) current.current = { ...props, data };
    const width = Math.floor(size.width);
    if (!room.current || !current.current || width < 50) return;
    // One out of sight too, as it would stay wider than a window that has become narrow.
    if (plot.current && plot.current.width !== width) plot.current.setSize({ width, height });
    if (!visible) return;
    if (plot.current && plot.current.root.dataset.structure !== structure) {
      plot.current.destroy();
      plot.current = null;
    }
    if (!plot.current) {
      plot.current = new uPlot(optionsOf(current, width, height), current.current.data, room.current);
      plot.current.root.dataset.structure = structure;
    } else plot.current.setData(current.current.data, true);
  }, [data, structure, size.width, visible, zoom?.from, zoom?.to, references]);

  useEffect(
    () => () => {
      plot.current?.destroy();
      plot.current = null;
    },
    [],
  );

  const named = lines.filter((line) => !line.faint).slice(0, 8);
  const summary = named.map((line) => `${line.label}: last ${format(lastOf(line))}`);
  const move = (event: KeyboardEvent): void => {
    const step = event.key === 'ArrowRight' ? 1 : event.key === 'ArrowLeft' ? -1 : 0;
    const u = plot.current;
    if (!u || !step) return;
    const x = u.data[0];
    event.preventDefault();
    const from = u.cursor.idx ?? (step > 0 ? -1 : x.length);
    const stride = Math.max(1, Math.round(x.length / 100)) * (event.shiftKey ? 5 : 1);
    const to = Math.min(Math.max(from + step * stride, 0), x.length - 1);
    u.setCursor({ left: u.valToPos(x[to] ?? 0, 'x'), top: u.over.clientHeight / 3 });
  };
  return (
    <div
      ref={room}
      class="plot"
      role="img"
      tabIndex={0}
      style={{ minHeight: `${height}px` }}
      aria-label={`${title} over ${xLabel}. ${summary.join('; ')}. Arrow keys move the cursor.`}
      onKeyDown={move}
      onBlur={() => plot.current?.setCursor({ left: -10, top: -10 })}
    />
  );
}

function dataOf(lines: readonly Line[]): uPlot.AlignedData {
  return align(lines.flatMap((line) => (line.band ? [{ x: line.x, y: line.band.high }, { x: line.x, y: line.band.low }, line] : [line])));
}

function optionsOf(current: { current: Current | null }, width: number, height: number): uPlot.Options {
  const { lines, sync, xLabel, yLabel } = current.current as Current;
  const text = colourOf('text-soft');
  const grid = { stroke: colourOf('line-soft'), width: 1 };
  const font = '12px "Inter Variable", system-ui, sans-serif';
  const labelled = (label: string): Partial<uPlot.Axis> => ({ label, labelFont: font, labelSize: 18, labelGap: 0 });
  const series: uPlot.Series[] = [{}];
  const bands: uPlot.Band[] = [];
  for (const line of lines) {
    const stroke = colourOf(line.colour);
    if (line.band) {
      const edge: uPlot.Series = { width: 0, stroke: 'transparent', points: { show: false }, spanGaps: true };
      bands.push({ series: [series.length, series.length + 1], fill: alpha(stroke, 0.16) });
      series.push(edge, edge);
    }
    series.push({
      stroke: line.faint ? alpha(stroke, 0.35) : stroke,
      width: line.faint ? 1 : 2,
      spanGaps: true,
      points: { show: (u) => u.data[0].length < 24 && !line.faint, size: 5, fill: stroke },
    });
  }
  return {
    width,
    height,
    series,
    bands,
    legend: { show: false },
    padding: [10, 18, 0, 0],
    scales: {
      x: {
        time: false,
        range: (_, low, high) => {
          const { zoom } = current.current as Current;
          return zoom ? [zoom.from, zoom.to] : low === high ? [low - 1, high + 1] : [low, high];
        },
      },
      y: {
        range: (_, low, high) => {
          const { references, max = Infinity } = current.current as Current;
          const values = [low, high, ...references.map((reference) => reference.value)].filter(
            (value) => value !== null && Number.isFinite(value),
          );
          const least = Math.min(...values);
          const greatest = Math.max(...values);
          if (!Number.isFinite(least)) return [0, 1];
          const margin = (greatest - least || Math.abs(greatest) || 1) * 0.06;
          // A line along the greatest value is drawn whole.
          return [least - margin, Math.min(greatest + margin, Math.max(greatest, max) + margin / 12)];
        },
      },
    },
    axes: [
      {
        stroke: text,
        font,
        grid: { show: false },
        ticks: { ...grid, size: 4 },
        size: 26,
        gap: 4,
        ...labelled(xLabel),
        space: 64,
        values: (_, splits) => splits.map(current.current?.xFormat ?? short),
      },
      {
        stroke: text,
        font,
        grid,
        ticks: { show: false },
        size: 52,
        gap: 6,
        ...labelled(yLabel),
        space: 36,
        values: (_, splits) => splits.map((value) => (current.current?.format ?? significant)(value)),
      },
    ],
    cursor: {
      x: true,
      y: false,
      points: { show: false },
      drag: { x: current.current?.onZoom !== undefined, y: false, setScale: false },
      ...(sync ? { sync: { key: sync, scales: ['x', null], setSeries: false } } : {}),
    },
    hooks: {
      draw: [(u) => drawReferences(u, current.current?.references ?? [], text)],
      setSelect: [
        (u) => {
          if (u.select.width < 4) return;
          const from = u.posToVal(u.select.left, 'x');
          const to = u.posToVal(u.select.left + u.select.width, 'x');
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          current.current?.onZoom?.({ from, to });
        },
      ],
    },
    plugins: [tooltip(current)],
  };
}

const DASHES = [
  [7, 4],
  [2, 4],
  [10, 3, 2, 3],
  [1, 3],
];

function drawReferences(u: uPlot, references: readonly Reference[], stroke: string): void {
  const { ctx, bbox } = u;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = stroke;
  ctx.lineWidth = 1.2 * ratio;
  references.forEach(({ value }, i) => {
    const y = Math.round(u.valToPos(value, 'y', true));
    if (y < bbox.top || y > bbox.top + bbox.height) return;
    ctx.setLineDash((DASHES[i % DASHES.length] ?? []).map((length) => length * ratio));
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  });
  ctx.restore();
}

/** Names the dashed lines. */
function References({ list, format }: { list: readonly Reference[]; format: (value: number | null) => string }): JSX.Element {
  return (
    <ul class="legend fine">
      {list.map((reference, i) => (
        <li key={reference.label} class="row">
          <svg class="swatch" viewBox="0 0 22 8" aria-hidden="true">
            <line x2="22" y1="4" y2="4" stroke="currentColor" stroke-width="1.5" stroke-dasharray={(DASHES[i % DASHES.length] ?? []).join(' ')} />
          </svg>
          {reference.label}
          <span class="number">{format(reference.value)}</span>
        </li>
      ))}
    </ul>
  );
}

function alpha(colour: string, opacity: number): string {
  return `color-mix(in srgb, ${colour} ${100 * opacity}%, transparent)`;
}

const TOOLTIP_LINES = 8;

/** Shows the values of the lines at the cursor. */
function tooltip(current: { current: Current | null }): uPlot.Plugin {
  const box = document.createElement('div');
  box.className = 'framed tooltip';
  box.hidden = true;
  box.setAttribute('aria-live', 'polite');
  return {
    hooks: {
      init: (u) => {
        u.over.append(box);
      },
      setCursor: (u) => {
        const { left = -1, idx } = u.cursor;
        const props = current.current;
        if (left < 0 || idx === null || idx === undefined || !props) {
          box.hidden = true;
          return;
        }
        const x = u.posToVal(left, 'x');
        const rows = props.lines
          .filter((line) => !line.faint)
          .map((line) => ({ line, value: nearestValue(line, x) }))
          .filter((row): row is { line: Line; value: number } => row.value !== null)
          .slice(0, TOOLTIP_LINES);
        render(
          <>
            <p>{`${(props.xFormat ?? short)(u.data[0][idx] ?? x)} ${props.xLabel}`}</p>
            {rows.map(({ line, value }) => (
              <div key={line.key}>
                <i style={{ background: `var(--${line.colour})` }} />
                <span>{line.label}</span>
                <b>{(props.format ?? significant)(value)}</b>
              </div>
            ))}
          </>,
          box,
        );
        box.hidden = rows.length === 0;
        const right = left > u.over.clientWidth / 2;
        box.style.left = right ? '' : `${left + 12}px`;
        box.style.right = right ? `${u.over.clientWidth - left + 12}px` : '';
      },
    },
  };
}

/** Returns the value of a line's point nearest to x; null beyond its ends. */
function nearestValue(line: Line, x: number): number | null {
  const after = lowerBound(line.x, x);
  const last = line.x.length - 1;
  if (last < 0 || after > last || (after === 0 && (line.x[0] as number) > x && line.x.length > 1)) return null;
  const before = Math.max(after - 1, 0);
  const near = x - (line.x[before] as number) < (line.x[after] as number) - x ? before : after;
  return line.y[near] ?? null;
}
