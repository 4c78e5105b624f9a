// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useMemo, useState } from 'preact/hooks';
import type { Recognition as Result, RecognitionCurve, RecognitionRow } from '../api/types';
import type { Line } from '../maths/curves';
import { fixed, integer, threeDecimals } from '../maths/format';
import { useJson } from '../state/resource';
import { param, setParams } from '../state/router';
import { seriesColour } from '../state/theme';
import { Card, Empty, Failed, Guard, Loading, Select, Show, Swatch, Tick } from '../ui/basics';
import { Chart } from '../ui/chart';
import { Whisker } from '../ui/marks';
import { figure, TableCard, text, type Column } from '../ui/table';

export function Recognition(): JSX.Element {
  const results = useJson<{ results: Result[] }>('api/recognition');
  return (
    <Show of={results}>
      {({ results: list }) => {
        const chosen = list.find((one) => one.name === param('result', '')) ?? list[0];
        return chosen ? (
          <>
            {list.length > 1 && (
              <div class="wrap card">
                <Select
                  label="Result"
                  value={chosen.name}
                  options={list.map((one) => ({ value: one.name, label: one.name }))}
                  onChange={(name) => setParams({ result: name, row: null })}
                />
              </div>
            )}
            <Guard key={chosen.name}>
              <ResultOf result={chosen} />
            </Guard>
          </>
        ) : (
          <Card title="Results">
            <Empty title="No place-recognition results">
              <code>citylearn vpr --dataset plain --data DIR --reference summer --query winter</code> writes results; start the dashboard
              with <code>--recognition DIR</code>, where DIR holds them.
            </Empty>
          </Card>
        );
      }}
    </Show>
  );
}

function rowName(row: Pick<RecognitionRow, 'encoder' | 'dimension' | 'centring' | 'method' | 'query'>): string {
  return `${row.encoder} ${row.dimension}, ${row.centring}, ${row.method}, ${row.query}`;
}

/** Returns the file name that vpr gives a row: everything but letters, digits, '.', '_' becomes '-'. */
function matrixFile(row: RecognitionRow): string {
  const slug = (text: string): string => text.replace(/[^A-Za-z0-9._]/g, '-');
  return `similarity-${slug(row.encoder)}-${row.dimension}-${row.centring}-${slug(row.query)}-${slug(row.method)}.png`;
}

const SHOWN_AT_FIRST = 6;

type Row = RecognitionRow & { index: number };

function ResultOf({ result }: { result: Result }): JSX.Element {
  const rows = useMemo(() => (result.rows ?? []).map((row, index): Row => ({ ...row, index })), [result]);
  const path = `api/recognition/${encodeURIComponent(result.name)}`;
  const curves = useJson<{ curves: RecognitionCurve[] }>(result.error ? null : `${path}/curve`);
  const [shown, setShown] = useState<ReadonlySet<number>>(() => new Set(rows.slice(0, SHOWN_AT_FIRST).keys()));
  const lines: Line[] = useMemo(() => {
    if (curves.state !== 'ready') return [];
    return rows.flatMap((row) => {
      const curve = curves.value.curves.find((one) => rowName(one) === rowName(row));
      if (!curve || !shown.has(row.index)) return [];
      return [{ key: String(row.index), label: rowName(row), colour: seriesColour(row.index), dashed: row.index >= 8, ...ascending(curve) }];
    });
  }, [curves, shown, rows]);
  if (result.error) return <Failed error={result.error} />;
  const toggle = (index: number): void => {
    const next = new Set(shown);
    if (!next.delete(index)) next.add(index);
    setShown(next);
  };
  const columns: Column<Row>[] = [
    {
      ...text('encoder', 'Curve'),
      key: 'row',
      show: (row) => (
        <Tick checked={shown.has(row.index)} onChange={() => toggle(row.index)} label={`Curve of ${rowName(row)}`}>
          <Swatch colour={seriesColour(row.index)} dashed={row.index >= 8} />
          {row.encoder}
        </Tick>
      ),
    },
    figure('dimension', 'Dimension', integer),
    text('centring', 'Centring'),
    text('method', 'Method'),
    text('query', 'Query'),
    { ...text('auc', 'AUC, 95 % interval'), show: (row) => interval(row.auc, row.auc_interval) },
    { ...text('recall_1', 'Recall@1, 95 % interval'), show: (row) => interval(row.recall_1 ?? 0, row.recall_1_interval) },
    figure('recall_5', 'Recall@5', threeDecimals),
    figure('recall_10', 'Recall@10', threeDecimals),
    figure('recall_at_full_precision', 'Recall at precision 1', threeDecimals),
    figure('queries', 'Queries', integer),
  ];
  return (
    <>
      <div class="columns recognition-columns">
        {curves.state === 'loading' ? (
          <Card title="Precision over recall">
            <Loading lines={6} />
          </Card>
        ) : (
          <Chart
            title="Precision over recall"
            hint={[result.name, result.reference && `reference ${result.reference}`, result.ground_truth].filter(Boolean).join(' · ')}
            name={result.name}
            xLabel="recall"
            yLabel="precision"
            lines={lines}
            format={(value) => fixed(value, 2)}
            xFormat={(value) => fixed(value, 2)}
            xRange={[0, 1]}
            yRange={[0, 1.02]}
            height={430}
            empty={curves.state === 'failed' ? curves.error : 'Choose a curve in the table'}
          />
        )}
        <Matrix result={result} rows={rows} path={path} />
      </div>
      <TableCard
        title="Figures"
        hint={result.command}
        name={`recognition ${result.name}`}
        caption="Place recognition"
        columns={columns}
        rows={rows}
        rowKey={(row) => row.index}
        empty={<Empty title="No results yet" />}
      />
    </>
  );
}

const interval = (value: number, [low, high]: [number, number]): JSX.Element => <Whisker value={value} low={low} high={high} />;

/** Returns the curve by ascending recall. Of equal recalls it keeps the first point, which has the highest precision. */
function ascending(curve: RecognitionCurve): { x: number[]; y: number[] } {
  const x: number[] = [];
  const y: number[] = [];
  curve.recall.forEach((recall, i) => {
    if (x.length > 0 && recall <= (x[x.length - 1] as number)) return;
    x.push(recall);
    y.push(curve.precision[i] ?? 0);
  });
  return { x, y };
}

function Matrix({ result, rows, path }: { result: Result; rows: readonly RecognitionRow[]; path: string }): JSX.Element {
  const files = result.matrices ?? [];
  const named = files.map((file) => {
    const row = rows.find((one) => matrixFile(one) === file);
    return { value: file, label: row ? rowName(row) : file };
  });
  const file = files.find((one) => one === param('matrix', '')) ?? files[0];
  const chosen = named.find((one) => one.value === file);
  return (
    <Card title="Similarity" hint="columns: query frames; rows: reference frames; bright: similar">
      {file && chosen ? (
        <div class="stack">
          {files.length > 1 && <Select label="Of" value={file} options={named} onChange={(value) => setParams({ matrix: value })} />}
          <img class="matrix" src={`${path}/matrix?file=${encodeURIComponent(file)}`} alt={`Similarity matrix of ${chosen.label}`} />
        </div>
      ) : (
        <Empty title="No picture">vpr ran with --no-pictures.</Empty>
      )}
    </Card>
  );
}
