// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useMemo, useState } from 'preact/hooks';
import { remove, runPath } from '../api/client';
import type { Evaluation, Run, RunDetail } from '../api/types';
import { curveOf } from '../maths/curves';
import { newest } from '../maths/evaluations';
import { dateTime, duration, fixed, integer, percent, plural, short, significant } from '../maths/format';
import { groupRuns, type Group } from '../maths/groups';
import { compareManifests, type ManifestRow } from '../maths/manifest';
import { deviation, mean, median } from '../maths/seeds';
import { failure, useJsons } from '../state/resource';
import { param, place, setParams } from '../state/router';
import { useTraining } from '../state/training';
import { Card, Empty, Failed, IconButton, Select, State, Swatch } from '../ui/basics';
import { Chart, type Line } from '../ui/chart';
import { AXIS, Choice, chosen, GROUPS, type ChoiceOf } from '../ui/choice';
import { runName } from '../ui/run_select';
import { SaveTable, Table, type Column } from '../ui/table';
import { WithRuns } from '../ui/with_runs';

export function Compare(): JSX.Element {
  return (
    <WithRuns title="Runs" empty="Compare two or more runs here, with the differences between their manifests.">
      {(all) => <CompareRuns all={all} />}
    </WithRuns>
  );
}

const OPTIONS: ChoiceOf<'differing' | 'all'> = { name: 'keys', label: 'Options', values: { differing: 'Differing', all: 'All' } };
const MAX_RUNS = 8;

function chosenRuns(all: readonly Run[]): Run[] {
  const wanted = place.value.params.get('runs');
  if (wanted === null) return groupRuns(all, 'sweep').flatMap((group) => group.runs.slice(0, 1)).slice(0, 3);
  const ids = new Set(wanted.split('\n'));
  return all.filter((run) => ids.has(run.id)).slice(0, MAX_RUNS);
}

const colourOf = (index: number): string => `series-${(index % 8) + 1}`;

function CompareRuns({ all }: { all: readonly Run[] }): JSX.Element {
  const selected = chosenRuns(all);
  return (
    <>
      <Groups all={all} />
      <Index all={all} selected={selected} />
      {selected.length > 0 ? (
        <>
          <Curves selected={selected} />
          <SideBySide selected={selected} />
        </>
      ) : (
        <Card title="Side by side">
          <Empty title="Choose runs above" />
        </Card>
      )}
    </>
  );
}

/** Statistics over all seeds of a group, whichever runs are chosen. */
function Groups({ all }: { all: readonly Run[] }): JSX.Element {
  const by = chosen(GROUPS);
  const groups = useMemo(() => groupRuns(all, by), [all, by]);
  const spread = (group: Group, of: (run: Run) => number | null, show: (value: number) => string): string => {
    const values = group.runs.map(of).filter((value): value is number => value !== null);
    const middle = median(values);
    if (middle === null) return '–';
    return values.length === 1 ? show(middle) : `${show(middle)} (${show(Math.min(...values))} to ${show(Math.max(...values))})`;
  };
  const meanOf = (group: Group): number | null => {
    const values = group.runs.map((run) => run.spl).filter((value): value is number => value !== null);
    return values.length ? mean(values) : null;
  };
  const deviationOf = (group: Group): number | null => deviation(group.runs.flatMap((run) => (run.spl === null ? [] : [run.spl])));
  const three = (value: number): string => fixed(value, 3);
  const columns: Column<Group>[] = [
    { key: 'group', label: 'Group', show: (g) => g.label, cell: (g) => g.label },
    { key: 'seeds', label: 'Seeds', number: true, show: (g) => g.runs.length, cell: (g) => g.runs.length },
    { key: 'spl', label: 'SPL: median (lowest to highest)', number: true, show: (g) => spread(g, (r) => r.spl, three), cell: (g) => spread(g, (r) => r.spl, three) },
    { key: 'spl_mean', label: 'SPL: mean', number: true, show: (g) => fixed(meanOf(g), 3), cell: meanOf },
    { key: 'spl_deviation', label: 'deviation', number: true, show: (g) => fixed(deviationOf(g), 3), cell: deviationOf },
    { key: 'reward', label: 'Reward', number: true, show: (g) => spread(g, (r) => r.reward, three), cell: (g) => spread(g, (r) => r.reward, three) },
    { key: 'episodes', label: 'Episodes', number: true, show: (g) => spread(g, (r) => r.episodes, short), cell: (g) => spread(g, (r) => r.episodes, integer) },
    { key: 'wall', label: 'Training time', number: true, show: (g) => spread(g, (r) => r.wall, duration), cell: (g) => spread(g, (r) => r.wall, String) },
  ];
  return (
    <Card
      title="Over seeds"
      hint="Training, last 100 episodes. Counts every seed, whichever runs are chosen below."
      actions={<SaveTable name="groups" columns={columns} rows={groups} />}
    >
      <div class="controls plain">
        <Choice of={GROUPS} />
      </div>
      <Table caption="Groups of runs" columns={columns} rows={groups} rowKey={(g) => g.key} />
    </Card>
  );
}

function Index({ all, selected }: { all: readonly Run[]; selected: readonly Run[] }): JSX.Element {
  const [error, setError] = useState<string | null>(null);
  const [doomed, setDoomed] = useState<string | null>(null);
  const toggle = (id: string): void => {
    const ids = selected.map((run) => run.id);
    setParams({ runs: (ids.includes(id) ? ids.filter((one) => one !== id) : [...ids, id]).join('\n') });
  };
  const erase = (id: string): void => {
    setDoomed(null);
    remove(runPath(id)).catch((cause: unknown) => setError(failure(cause).error));
  };
  const columns: Column<Run>[] = [
    {
      key: 'run',
      label: 'Run',
      show: (run) => {
        const at = selected.indexOf(run);
        return (
          <label class="agent-choice">
            <input
              type="checkbox"
              checked={at >= 0}
              disabled={at < 0 && selected.length >= MAX_RUNS}
              onChange={() => toggle(run.id)}
            />
            {at >= 0 && <Swatch colour={colourOf(at)} />}
            {runName(run)}
          </label>
        );
      },
      cell: (run) => run.id,
    },
    { key: 'state', label: 'State', show: (run) => <State state={run.state} />, cell: (run) => run.state },
    { key: 'started', label: 'Started', show: (run) => dateTime(run.started), cell: (run) => run.started },
    { key: 'episodes', label: 'Episodes', number: true, show: (run) => short(run.episodes), cell: (run) => run.episodes },
    { key: 'steps', label: 'Steps', number: true, show: (run) => short(run.steps), cell: (run) => run.steps },
    { key: 'wall', label: 'Time', number: true, show: (run) => duration(run.wall), cell: (run) => run.wall },
    { key: 'reward', label: 'Reward', number: true, show: (run) => fixed(run.reward, 3), cell: (run) => run.reward },
    { key: 'spl', label: 'SPL', number: true, show: (run) => fixed(run.spl, 3), cell: (run) => run.spl },
    {
      key: 'remove',
      label: 'Remove',
      quiet: true,
      show: (run) =>
        doomed === run.id ? (
          <span class="confirm">
            <button type="button" class="small danger" onClick={() => erase(run.id)}>
              Remove with its episodes
            </button>
            <button type="button" class="small" onClick={() => setDoomed(null)}>
              Keep
            </button>
          </span>
        ) : (
          <IconButton
            icon="trash"
            label={`Remove ${runName(run)}`}
            disabled={run.state === 'running'}
            onClick={() => setDoomed(run.id)}
          />
        ),
    },
  ];
  return (
    <Card
      title="Runs"
      hint={`${plural(all.length, 'run')}; at most ${MAX_RUNS} side by side`}
      actions={<SaveTable name="runs" columns={columns} rows={all} />}
    >
      {error && <Failed error={error} />}
      <Table caption="Runs" columns={columns} rows={all} rowKey={(run) => run.id} />
    </Card>
  );
}

const METRICS: { value: string; label: string }[] = [
  { value: 'spl', label: 'SPL' },
  { value: 'reward', label: 'Reward' },
  { value: 'episode_length', label: 'Episode length' },
  { value: 'entropy', label: 'Entropy' },
  { value: 'steps_per_second', label: 'Steps per second' },
];

function Curves({ selected }: { selected: readonly Run[] }): JSX.Element {
  const metric = METRICS.find((one) => one.value === param('metric', 'spl')) ?? { value: 'spl', label: 'SPL' };
  const x = chosen(AXIS);
  const training = useTraining(selected.map((run) => run.id));
  const versions = selected.map((run) => training.get(run.id)?.version ?? 0).join();
  const lines: Line[] = useMemo(
    () =>
      selected.flatMap((run, i) => {
        const rows = training.get(run.id)?.rows;
        return rows?.length
          ? [{ key: run.id, label: runName(run), colour: colourOf(i), ...curveOf(rows, { metric: metric.value, x, smoothing: 0.9 }) }]
          : [];
      }),
    [versions, selected.map((run) => run.id).join('\n'), metric.value, x],
  );
  return (
    <div class="stack">
      <div class="controls card">
        <Select label="Figure" value={metric.value} options={METRICS} onChange={(value) => setParams({ metric: value })} />
        <Choice of={AXIS} />
      </div>
      <Chart
        title={metric.label}
        hint="smoothed with 0.9"
        name="compare"
        xLabel={x === 'wall' ? 'wall time' : x}
        xFormat={x === 'wall' ? duration : short}
        format={metric.value === 'steps_per_second' ? short : (value) => significant(value)}
        lines={lines}
        height={300}
        legend
      />
    </div>
  );
}

interface FigureRow {
  key: string;
  values: string[];
}

function SideBySide({ selected }: { selected: readonly Run[] }): JSX.Element {
  const details = useJsons<RunDetail>(selected.map((run) => runPath(run.id)));
  const evaluations = useJsons<{ evaluations: Evaluation[] }>(selected.map((run) => runPath(run.id, '/evaluations')));
  const manifests = selected.map((run) => {
    const detail = details.get(runPath(run.id));
    return detail?.state === 'ready' ? detail.value.manifest : null;
  });
  const rows = compareManifests(manifests);
  const shown = chosen(OPTIONS) === 'all' ? rows : rows.filter((row) => row.differs);
  const last = selected.map((run) => {
    const answer = evaluations.get(runPath(run.id, '/evaluations'));
    return answer?.state === 'ready' ? newest(answer.value.evaluations) : new Map<string, Evaluation>();
  });
  const traversals = [...new Set(last.flatMap((one) => [...one.keys()]))];
  const of = (key: string, value: (run: Run, index: number) => string): FigureRow => ({ key, values: selected.map(value) });
  const figures: FigureRow[] = [
    of('State', (run) => run.state),
    of('Seed', (run) => (run.seed === null ? '–' : String(run.seed))),
    of('Updates', (run) => integer(run.updates)),
    of('Steps', (run) => integer(run.steps)),
    of('Episodes', (run) => integer(run.episodes)),
    of('Training time', (run) => duration(run.wall)),
    of('Steps per second', (run) => short(run.steps_per_second)),
    of('Reward, last 100 episodes', (run) => fixed(run.reward, 3)),
    of('SPL, last 100 episodes', (run) => fixed(run.spl, 3)),
    ...traversals.flatMap((name) => [
      of(`${name}: SPL of the last checkpoint`, (_, i) => fixed(last[i]?.get(name)?.spl, 3)),
      of(`${name}: completed`, (_, i) => percent(last[i]?.get(name)?.completed)),
    ]),
  ];
  const head = (run: Run, i: number): JSX.Element => (
    <span class="agent-choice">
      <Swatch colour={colourOf(i)} />
      {runName(run)}
    </span>
  );
  const figureColumns: Column<FigureRow>[] = [
    { key: 'figure', label: 'Figure', show: (row) => row.key, cell: (row) => row.key },
    ...selected.map((run, i) => ({
      key: run.id,
      label: runName(run),
      number: true,
      show: (row: FigureRow) => row.values[i] ?? '–',
      cell: (row: FigureRow) => row.values[i],
    })),
  ];
  const manifestColumns: Column<ManifestRow>[] = [
    { key: 'key', label: 'Option', show: (row) => row.key, cell: (row) => row.key },
    ...selected.map((run, i) => ({
      key: run.id,
      label: runName(run),
      show: (row: ManifestRow) => <span class={row.differs ? 'differs' : undefined}>{row.values[i] ?? '–'}</span>,
      cell: (row: ManifestRow) => row.values[i],
    })),
  ];
  return (
    <>
      <Card title="Side by side" actions={<SaveTable name="figures" columns={figureColumns} rows={figures} />}>
        <ul class="legend">{selected.map((run, i) => <li key={run.id}>{head(run, i)}</li>)}</ul>
        <Table caption="Figures of the chosen runs" columns={figureColumns} rows={figures} rowKey={(row) => row.key} />
      </Card>
      <Card
        title="Manifests"
        hint={`${plural(rows.filter((row) => row.differs).length, 'option')} of ${integer(rows.length)} ${rows.length === 1 ? 'differs' : 'differ'}`}
        actions={<SaveTable name="manifests" columns={manifestColumns} rows={shown} />}
      >
        <div class="controls plain">
          <Choice of={OPTIONS} />
        </div>
        {shown.length ? (
          <Table caption="Manifests of the chosen runs" columns={manifestColumns} rows={shown} rowKey={(row) => row.key} />
        ) : (
          <Empty title={rows.length ? 'All options are equal' : 'No manifest available'} />
        )}
      </Card>
    </>
  );
}
