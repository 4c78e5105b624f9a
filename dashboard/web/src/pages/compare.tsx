// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useState } from 'preact/hooks';
import { request, runPath } from '../api/client';
import type { Evaluation, Run, RunDetail } from '../api/types';
import { newest } from '../maths/evaluations';
import { dateTime, duration, fixed, integer, percent, plural, short, threeDecimals } from '../maths/format';
import { groupRuns, type Group } from '../maths/groups';
import { artefactsOf, compareManifests, type Fact } from '../maths/manifest';
import { isKnown, meanRate, runName } from '../maths/runs';
import { deviation, known, mean, median } from '../maths/seeds';
import { useGroups } from '../state/groups';
import { failure, useJsons, valueOf } from '../state/resource';
import { param, place, setParams, usePinned } from '../state/router';
import { Card, Empty, Failed, IconButton, State, Tick } from '../ui/basics';
import { Choice, chosen, GROUPS, type ChoiceOf } from '../ui/choice';
import { figure, TableCard, text, type Column } from '../ui/table';
import { WithRuns } from '../ui/with_runs';

export function Compare(): JSX.Element {
  return (
    <WithRuns title="Runs" empty="Compare two or more runs here, with the differences between their manifests.">
      {(all) => <CompareRuns all={all} />}
    </WithRuns>
  );
}

const OPTIONS: ChoiceOf<'differing' | 'all'> = { name: 'keys', label: 'Options', values: { differing: 'Differing', all: 'All' } };
const FIGURES: ChoiceOf<'differing' | 'all'> = { name: 'figures', label: 'Figures', values: { differing: 'Differing', all: 'All' } };
const MAX_RUNS = 8;
const MAX_ROWS = 100; // of the list of runs, until all are asked for: a thousand rows take a browser seconds

function chosenRuns(all: readonly Run[]): Run[] {
  const wanted = place.value.params.get('runs');
  if (wanted === null) return groupRuns(all, 'sweep').flatMap((group) => group.runs.slice(0, 1)).slice(0, 3);
  const ids = new Set(wanted.split('\n'));
  return all.filter((run) => ids.has(run.id)).slice(0, MAX_RUNS);
}

function CompareRuns({ all }: { all: readonly Run[] }): JSX.Element {
  const selected = chosenRuns(all);
  usePinned('runs', selected.filter(isKnown).map((run) => run.id).join('\n') || null);
  return (
    <>
      <Groups all={all} />
      <Index all={all} selected={selected} />
      {selected.length > 0 ? (
        <SideBySide selected={selected} />
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
  const groups = useGroups(all, by);
  const spread = (key: 'spl' | 'reward' | 'episodes' | 'wall', label: string, show: (value: number) => string, save = show): Column<Group> => {
    const of = (group: Group, format: (value: number) => string): string => {
      const values = known(group.runs.map((run) => run[key]));
      const middle = median(values);
      if (middle === null) return '–';
      return values.length === 1 ? format(middle) : `${format(middle)} (${format(Math.min(...values))} to ${format(Math.max(...values))})`;
    };
    return { key, label, number: true, show: (group) => of(group, show), cell: (group) => of(group, save) };
  };
  const statistic = (key: string, label: string, of: (values: number[]) => number | null): Column<Group> => {
    const value = (group: Group): number | null => of(known(group.runs.map((run) => run.spl)));
    return { key, label, number: true, show: (group) => threeDecimals(value(group)), cell: value };
  };
  const columns: Column<Group>[] = [
    { ...text('label', 'Group'), key: 'group' },
    { key: 'seeds', label: 'Seeds', number: true, cell: (group) => group.runs.length },
    spread('spl', 'SPL: median (lowest to highest)', threeDecimals),
    statistic('spl_mean', 'SPL: mean', (values) => (values.length ? mean(values) : null)),
    statistic('spl_deviation', 'deviation', deviation),
    spread('reward', 'Reward', threeDecimals),
    spread('episodes', 'Episodes', short, integer),
    spread('wall', 'Training time', duration, String),
  ];
  return (
    <TableCard
      title="Over seeds"
      hint="Training, last 100 episodes. Counts every seed, whichever runs are chosen below."
      name="groups"
      caption="Groups of runs"
      columns={columns}
      rows={groups}
      rowKey={(group) => group.key}
    >
      <div class="wrap">
        <Choice of={GROUPS} />
      </div>
    </TableCard>
  );
}

function Index({ all, selected }: { all: readonly Run[]; selected: readonly Run[] }): JSX.Element {
  const [error, setError] = useState<string | null>(null);
  const [doomed, setDoomed] = useState<string | null>(null);
  const [whole, setWhole] = useState(false);
  const toggle = (id: string): void => {
    const ids = selected.map((run) => run.id);
    setParams({ runs: (ids.includes(id) ? ids.filter((one) => one !== id) : [...ids, id]).join('\n') });
  };
  const erase = (id: string): void => {
    setDoomed(null);
    request(runPath(id), { method: 'DELETE' }).catch((cause: unknown) => setError(failure(cause).error));
  };
  const find = param('find', '').toLowerCase();
  const rows = all.filter((run) => `${runName(run)} ${run.id}`.toLowerCase().includes(find));
  const listed = whole ? rows : rows.filter((run, i) => i < MAX_ROWS || selected.includes(run));
  const columns: Column<Run>[] = [
    {
      key: 'run',
      label: 'Run',
      show: (run) => {
        const at = selected.indexOf(run);
        return (
          <Tick checked={at >= 0} disabled={at < 0 && selected.length >= MAX_RUNS} onChange={() => toggle(run.id)}>
            {runName(run)}
          </Tick>
        );
      },
      cell: (run) => run.id,
    },
    { ...text('state', 'State'), show: (run) => <State state={run.state} /> },
    { ...figure('started', 'Started', dateTime), number: false },
    figure('episodes', 'Episodes', short),
    figure('steps', 'Steps', short),
    figure('wall', 'Time', duration),
    figure('reward', 'Reward', threeDecimals),
    figure('spl', 'SPL', threeDecimals),
    {
      key: 'remove',
      label: 'Remove',
      quiet: true,
      show: (run) =>
        doomed === run.id ? (
          <span class="row">
            <button type="button" class="danger" onClick={() => erase(run.id)}>
              Remove with its episodes
            </button>
            <button type="button" onClick={() => setDoomed(null)}>
              Keep
            </button>
          </span>
        ) : (
          <IconButton icon="trash" label={`Remove ${runName(run)}`} disabled={run.state === 'running'} onClick={() => setDoomed(run.id)} />
        ),
    },
  ];
  return (
    <TableCard
      title="Runs"
      hint={`${plural(all.length, 'run')}; at most ${MAX_RUNS} side by side`}
      name="runs"
      columns={columns}
      rows={listed}
      saved={rows}
      rowKey={(run) => run.id}
      below={
        listed.length < rows.length && (
          <button type="button" onClick={() => setWhole(true)}>
            Show all {integer(rows.length)} runs
          </button>
        )
      }
    >
      {all.length > MAX_ROWS && (
        <label class="field hint">
          <span>Find runs</span>
          <input type="search" value={param('find', '')} onInput={(event) => setParams({ find: event.currentTarget.value || null })} />
        </label>
      )}
      {error && <Failed error={error} />}
    </TableCard>
  );
}

interface RunFile {
  run: string;
  host: string;
  path: string;
}

const FILES: Column<RunFile>[] = [
  text('run', 'Run'),
  text('host', 'Host'),
  { ...text('path', 'Path'), show: (file) => <code class="path">{file.path}</code> },
];

function SideBySide({ selected }: { selected: readonly Run[] }): JSX.Element {
  const details = useJsons<RunDetail>(selected.map((run) => runPath(run.id)), selected.map((run) => run.state).join());
  const evaluations = useJsons<{ evaluations: Evaluation[] }>(selected.map((run) => runPath(run.id, '/evaluations')));
  const manifests = [...details.values()].map((detail) => valueOf(detail)?.manifest ?? null);
  const rows = compareManifests(manifests);
  const differing = rows.filter((row) => row.differs);
  const files = selected.flatMap((run, i): RunFile[] => {
    const artefacts = artefactsOf(manifests[i] ?? null);
    return (artefacts?.paths ?? []).map((path) => ({ run: runName(run), host: artefacts?.host ?? '', path }));
  });
  const last = selected.map((run) => {
    const answer = evaluations.get(runPath(run.id, '/evaluations'));
    return newest((answer && valueOf(answer)?.evaluations) ?? []);
  });
  const traversals = [...new Set(last.flatMap((one) => [...one.keys()]))];
  const of = (key: string, value: (run: Run, index: number) => string): Fact => {
    const values = selected.map(value);
    return { key, values, differs: new Set(values).size > 1 };
  };
  const figures: Fact[] = [
    of('State', (run) => run.state),
    of('Seed', (run) => String(run.seed ?? '–')),
    of('Updates', (run) => integer(run.updates)),
    of('Steps', (run) => integer(run.steps)),
    of('Episodes', (run) => integer(run.episodes)),
    of('Training time', (run) => duration(run.wall)),
    of('Steps per second, mean', (run) => short(meanRate(run))),
    of('Reward, last 100 episodes', (run) => threeDecimals(run.reward)),
    of('SPL, last 100 episodes', (run) => threeDecimals(run.spl)),
    ...traversals.flatMap((name) => [
      of(`${name}: SPL of the last checkpoint`, (_, i) => fixed(last[i]?.get(name)?.spl, 3)),
      of(`${name}: completed`, (_, i) => percent(last[i]?.get(name)?.completed)),
    ]),
  ].filter(({ values }) => values.some((value) => value !== null && value !== '–'));
  const differingFigures = figures.filter((row) => row.differs);
  const columns = (label: string, number: boolean): Column<Fact>[] => [
    { ...text('key', label), key: label.toLowerCase() },
    ...selected.map((run, i): Column<Fact> => {
      const value = (row: Fact): string => row.values[i] ?? '–';
      return {
        key: run.id,
        label: runName(run),
        number,
        show: (row) => (row.differs ? <b>{value(row)}</b> : value(row)),
        cell: (row) => row.values[i],
      };
    }),
  ];
  return (
    <>
      <TableCard
        title="Side by side"
        name="figures"
        caption="Figures of the chosen runs"
        columns={columns('Figure', true)}
        rows={chosen(FIGURES) === 'all' || selected.length < 2 ? figures : differingFigures}
        rowKey={(row) => row.key}
        empty={<Empty title="All figures are equal" />}
      >
        <div class="wrap">
          <Choice of={FIGURES} />
        </div>
      </TableCard>
      <TableCard
        title="Manifests"
        hint={`${plural(differing.length, 'option')} of ${integer(rows.length)} ${rows.length === 1 ? 'differs' : 'differ'}`}
        name="manifests"
        caption="Manifests of the chosen runs"
        columns={columns('Option', false)}
        rows={chosen(OPTIONS) === 'all' ? rows : differing}
        rowKey={(row) => row.key}
        empty={<Empty title={rows.length ? 'All options are equal' : 'No manifest available'} />}
      >
        <div class="wrap">
          <Choice of={OPTIONS} />
        </div>
      </TableCard>
      <TableCard
        title="Files"
        hint="Where the chosen runs write, on their own hosts"
        name="files"
        caption="Files of the chosen runs"
        columns={FILES}
        rows={files}
        rowKey={(file, i) => `${i} ${file.path}`}
        empty={<Empty title="No files known">Runs without --output write none, and those of older versions do not name them.</Empty>}
      />
    </>
  );
}
