// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useMemo, useState } from 'preact/hooks';
import type { Recognition as Result, RecognitionCurve, RecognitionRow } from '../api/types';
import { fixed, integer } from '../maths/format';
import { useJson } from '../state/resource';
import { param, setParams } from '../state/router';
import { Card, Empty, Failed, Loading, Select, Show, Swatch } from '../ui/basics';
import { Chart, type Line } from '../ui/chart';
import { Whisker } from '../ui/marks';
import { SaveTable, Table, type Column } from '../ui/table';

export function Recognition(): JSX.Element {
  const results = useJson<{ results: Result[] }>('api/recognition');
  return (
    <Show of={results}>
      {({ results: list }) => {
        const chosen = list.find((one) => one.name === param('result', '')) ?? list[0];
        return chosen ? (
          <>
            {list.length > 1 && (
              <div class="controls card">
                <Select
                  label="Result"
                  value={chosen.name}
                  options={list.map((one) => ({ value: one.name, label: one.name }))}
                  onChange={(name) => setParams({ result: name, row: null })}
                />
              </div>
            )}
            <ResultOf key={chosen.name} result={chosen} />
          </>
        ) : (
          <Card title="Results">
            <Empty title="No place-recognition results">
              <code>./run vpr --dataset plain --data DIR --reference summer --query winter</code> writes results; start the dashboard
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
export function matrixFile(row: RecognitionRow): string {
  const slug = (text: string): string => text.replace(/[^A-Za-z0-9._]/g, '-');
  return `similarity-${slug(row.encoder)}-${row.dimension}-${row.centring}-${slug(row.query)}-${slug(row.method)}.png`;
}

const SHOWN_AT_FIRST = 6;

interface Numbered {
  row: RecognitionRow;
  index: number;
}

function ResultOf({ result }: { result: Result }): JSX.Element {
  const rows = result.rows ?? [];
  const path = `api/recognition/${encodeURIComponent(result.name)}`;
  const curves = useJson<{ curves: RecognitionCurve[] }>(result.error ? null : `${path}/curve`);
  const [shown, setShown] = useState<ReadonlySet<number>>(() => new Set(rows.map((_, i) => i).slice(0, SHOWN_AT_FIRST)));
  const lines: Line[] = useMemo(() => {
    if (curves.state !== 'ready') return [];
    return rows.flatMap((row, i) => {
      const curve = curves.value.curves.find((one) => rowName(one) === rowName(row));
      if (!curve || !shown.has(i)) return [];
      return [{ key: String(i), label: rowName(row), colour: colourOf(i), dashed: i >= 8, ...ascending(curve) }];
    });
  }, [curves, shown, rows]);
  if (result.error) return <Failed error={result.error} />;
  const toggle = (index: number): void => {
    const next = new Set(shown);
    if (!next.delete(index)) next.add(index);
    setShown(next);
  };
  const list: Numbered[] = rows.map((row, index) => ({ row, index }));
  const columns: Column<Numbered>[] = [
    {
      key: 'row',
      label: 'Curve',
      show: ({ row, index }) => (
        <label class="agent-choice">
          <input type="checkbox" checked={shown.has(index)} onChange={() => toggle(index)} aria-label={`Curve of ${rowName(row)}`} />
          <Swatch colour={colourOf(index)} dashed={index >= 8} />
          {row.encoder}
        </label>
      ),
      cell: ({ row }) => row.encoder,
    },
    { key: 'dimension', label: 'Dimension', number: true, show: ({ row }) => integer(row.dimension), cell: ({ row }) => row.dimension },
    { key: 'centring', label: 'Centring', show: ({ row }) => row.centring, cell: ({ row }) => row.centring },
    { key: 'method', label: 'Method', show: ({ row }) => row.method, cell: ({ row }) => row.method },
    { key: 'query', label: 'Query', show: ({ row }) => row.query, cell: ({ row }) => row.query },
    {
      key: 'auc',
      label: 'AUC, 95 % interval',
      show: ({ row }) => <Whisker value={row.auc} low={row.auc_interval[0]} high={row.auc_interval[1]} />,
      cell: ({ row }) => row.auc,
    },
    {
      key: 'recall_1',
      label: 'Recall@1, 95 % interval',
      show: ({ row }) => <Whisker value={row.recall_1 ?? 0} low={row.recall_1_interval[0]} high={row.recall_1_interval[1]} />,
      cell: ({ row }) => row.recall_1,
    },
    { key: 'recall_5', label: 'Recall@5', number: true, show: ({ row }) => fixed(row.recall_5, 3), cell: ({ row }) => row.recall_5 },
    { key: 'recall_10', label: 'Recall@10', number: true, show: ({ row }) => fixed(row.recall_10, 3), cell: ({ row }) => row.recall_10 },
    {
      key: 'recall_at_full_precision',
      label: 'Recall at precision 1',
      number: true,
      show: ({ row }) => fixed(row.recall_at_full_precision, 3),
      cell: ({ row }) => row.recall_at_full_precision,
    },
    { key: 'queries', label: 'Queries', number: true, show: ({ row }) => integer(row.queries), cell: ({ row }) => row.queries },
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
      <Card
        title="Figures"
        hint={result.command}
        actions={<SaveTable name={`recognition ${result.name}`} columns={columns} rows={list} />}
      >
        {rows.length ? (
          <Table caption="Place recognition" columns={columns} rows={list} rowKey={({ index }) => index} />
        ) : (
          <Empty title="No results yet" />
        )}
      </Card>
    </>
  );
}

function colourOf(index: number): string {
  return `series-${(index % 8) + 1}`;
}

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
