// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useMemo } from 'preact/hooks';
import { runPath } from '../api/client';
import type { Episode, Evaluation, Run, RunDetail } from '../api/types';
import type { Line } from '../maths/curves';
import { byTraversal, checkpoints, evaluationKey, evaluationName, isControl, splMatrix } from '../maths/evaluations';
import { dateTime, fixed, integer, percent, plural, short, threeDecimals } from '../maths/format';
import { useJson, valueOf, type Resource } from '../state/resource';
import { param, setParams } from '../state/router';
import { seriesColour } from '../state/theme';
import { Card, Empty, Select, Show, State, toneOf } from '../ui/basics';
import { Chart } from '../ui/chart';
import { Choice, chosen, KIND, type ChoiceOf } from '../ui/choice';
import { CompletedBar, Heat, Whisker } from '../ui/marks';
import { chosenRun, RunSelect } from '../ui/run_select';
import { figure, TableCard, text, type Column } from '../ui/table';
import { WithRuns } from '../ui/with_runs';
import { Replay } from './replay';

const ORDER: ChoiceOf<'worst' | 'newest'> = { name: 'order', label: 'Order', values: { worst: 'Worst first', newest: 'Newest first' } };
const GOAL: ChoiceOf<'all' | 'reached' | 'missed'> = { name: 'goal', label: 'Goal', values: { all: 'All', reached: 'Reached', missed: 'Missed' } };

export function Deployment(): JSX.Element {
  return (
    <WithRuns title="Deployment" empty="Evaluations of trained agents and all recorded episodes appear here.">
      {(all) => <DeploymentOf run={chosenRun(all, 'ended')} all={all} />}
    </WithRuns>
  );
}

function DeploymentOf({ run, all }: { run: Run; all: readonly Run[] }): JSX.Element {
  // Fetched again as episodes are recorded; once for a run that has ended.
  const fresh = run.state === 'running' ? Math.floor((run.recorded_episodes ?? 0) / 500) : run.state;
  const evaluations = useJson<{ evaluations: Evaluation[] }>(runPath(run.id, '/evaluations'), fresh);
  const detail = useJson<RunDetail>(runPath(run.id), run.state);
  const episode = Number(param('episode', '0'));
  return (
    <>
      <div class="wrap card">
        <RunSelect runs={all} chosen={run} />
        <p class="row run-state">
          <State state={run.state} /> <span class="hint">{plural(run.recorded_episodes ?? 0, 'recorded episode')}</span>
        </p>
      </div>
      {episode > 0 && <Replay key={episode} rowid={episode} detail={detail} />}
      <Show of={evaluations} lines={8}>
        {({ evaluations: list }) =>
          list.length ? (
            <>
              <SplTable list={list} />
              <div class="tiles evaluations">
                {[...byTraversal(list)].map(([traversal, group]) => (
                  <EvaluationCard key={traversal} traversal={traversal} list={group} />
                ))}
              </div>
              <Checkpoints list={list} />
            </>
          ) : (
            <Card title="Evaluations">
              <Empty title="No evaluations yet">
                A policy_service evaluates at the end of its training, on each traversal of <code>--evaluate</code>, and with{' '}
                <code>--controls all</code> the reference policies too.
              </Empty>
            </Card>
          )
        }
      </Show>
      <Episodes run={run} evaluations={evaluations} fresh={fresh} />
    </>
  );
}

/** Shows SPL as a policy_service prints it at its end. */
export function SplTable({ list }: { list: readonly Evaluation[] }): JSX.Element {
  const { policies, rows } = useMemo(() => splMatrix(list), [list]);
  const columns: Column<(typeof rows)[number]>[] = [
    text('traversal', 'Traversal'),
    ...policies.map((policy): Column<(typeof rows)[number]> => {
      const spl = (row: (typeof rows)[number]): number | null => row.spl.get(policy) ?? null;
      return { key: policy, label: policy, number: true, cell: spl, show: (row) => <Heat share={spl(row)} /> };
    }),
  ];
  return (
    <TableCard
      title="SPL by traversal and policy"
      hint="Mean over the tasks, of the newest checkpoint. 1 is the shortest path every time. An agent that sees is better than blind, and worse on shuffled frames."
      name="spl"
      columns={columns}
      rows={rows}
      rowKey={(row) => row.traversal}
    />
  );
}

function EvaluationCard({ traversal, list }: { traversal: string; list: readonly Evaluation[] }): JSX.Element {
  const selected = param('evaluation', '');
  const alike = new Set(list.map((one) => one.tasks)).size === 1;
  const showWorst = (one: Evaluation): void => {
    setParams({ evaluation: evaluationKey(one), kind: 'evaluation', order: 'worst' });
    document.getElementById('episodes')?.scrollIntoView({ block: 'start' });
  };
  const columns: Column<Evaluation>[] = [
    { key: 'policy', label: 'Policy', cell: evaluationName },
    { ...text('completed', 'Completed'), show: (e) => <CompletedBar completed={e.completed} /> },
    { key: 'failed', label: 'Failed', number: true, show: (e) => integer(e.failed * e.tasks), cell: (e) => Math.round(e.failed * e.tasks) },
    { ...text('spl', 'SPL, 95 % interval'), show: (e) => <Whisker value={e.spl} low={e.spl_low} high={e.spl_high} /> },
    { ...text('spl_low', 'lowest'), hidden: true },
    { ...text('spl_high', 'highest'), hidden: true },
    figure('reward', 'Reward', threeDecimals),
    figure('mean_steps', 'Steps', (steps: number) => fixed(steps, 1)),
    figure('shortest_mean', 'Shortest', (steps: number) => fixed(steps, 1)),
    figure('excess', 'Steps / shortest', (excess: number | null) => fixed(excess, 2)),
    { ...figure('tasks', 'Tasks', integer), hidden: alike },
    {
      key: 'show',
      label: 'Tasks',
      quiet: true,
      show: (e) => (
        <button type="button" aria-label={`Worst tasks of ${evaluationName(e)} on ${traversal}`} onClick={() => showWorst(e)}>
          Worst
        </button>
      ),
    },
  ];
  return (
    <TableCard
      title={`On ${traversal}`}
      hint={alike ? `${integer(list[0]?.tasks)} tasks each` : undefined}
      name={`evaluations ${traversal}`}
      caption={`Evaluations on ${traversal}`}
      columns={columns}
      rows={list}
      rowKey={evaluationKey}
      rowClass={(e) => (evaluationKey(e) === selected ? 'chosen' : isControl(e) ? 'past' : undefined)}
    />
  );
}

function Checkpoints({ list }: { list: readonly Evaluation[] }): JSX.Element | null {
  const groups = checkpoints(list);
  const lines: Line[] = useMemo(
    () =>
      [...groups].map(([traversal, group], i) => ({
        key: traversal,
        label: traversal,
        colour: seriesColour(i),
        x: group.map((one) => one.update),
        y: group.map((one) => one.spl),
        band: { low: group.map((one) => one.spl_low), high: group.map((one) => one.spl_high) },
      })),
    [list],
  );
  if (![...groups.values()].some((group) => group.length > 1)) return null;
  return (
    <Chart
      title="SPL by checkpoint"
      hint="with 95 % intervals"
      name="checkpoints"
      xLabel="update"
      yLabel="SPL"
      max={1}
      lines={lines}
      format={threeDecimals}
      xFormat={short}
      legend
    />
  );
}

const PAGE = 50;

const goalOf = (one: Episode): string => (one.completed ? 'reached' : 'missed');

function Episodes({ run, evaluations, fresh }: {
  run: Run;
  evaluations: Resource<{ evaluations: Evaluation[] }>;
  fresh: unknown;
}): JSX.Element {
  const kind = chosen(KIND);
  const order = chosen(ORDER);
  const goal = chosen(GOAL);
  const limit = Math.min(Math.max(Number(param('limit', String(PAGE))) || PAGE, PAGE), 2000);
  const all = valueOf(evaluations)?.evaluations ?? [];
  const evaluated = kind === 'evaluation' ? all.find((one) => evaluationKey(one) === param('evaluation', '')) : undefined;
  const query = new URLSearchParams({ limit: String(limit), order, evaluation: kind === 'evaluation' ? '1' : '0' });
  if (evaluated) {
    for (const name of ['traversal', 'policy', 'update'] as const) query.set(name, String(evaluated[name]));
    query.set('shuffled', evaluated.shuffled ? '1' : '0');
  }
  if (goal !== 'all') query.set('completed', goal === 'reached' ? '1' : '0');
  const episodes = useJson<{ episodes: Episode[]; total: number }>(runPath(run.id, `/episodes?${query.toString()}`), fresh);
  const replayed = Number(param('episode', '0'));
  const taskOf = (e: Episode): string => (e.evaluation ? `Task ${e.task}` : `Episode ${e.episode}`);
  const columns: Column<Episode>[] = [
    {
      key: 'replay',
      label: 'Replay',
      show: (e) => (
        <button type="button" aria-label={`${taskOf(e)}: replay, row ${e.rowid}`} onClick={() => setParams({ episode: String(e.rowid), step: null })}>
          {taskOf(e)}
        </button>
      ),
      cell: (e) => e.rowid,
    },
    text('traversal', 'Traversal'),
    { key: 'policy', label: 'Policy', cell: evaluationName },
    { ...text('completed', 'Goal'), show: (e) => <b class={toneOf(goalOf(e))}>{goalOf(e)}</b> },
    figure('spl', 'SPL', threeDecimals),
    figure('steps', 'Steps', integer),
    figure('shortest', 'Shortest', integer),
    figure('reward', 'Reward', threeDecimals),
    figure('start', 'Start', integer),
    figure('goal', 'Goal frame', integer),
    { ...text('environment', 'Environment'), show: (e) => `${e.environment}, agent ${e.agent}` },
    { ...text('recorded', 'Recorded'), show: (e) => dateTime(e.recorded) },
  ];
  const { episodes: rows, total } = valueOf(episodes) ?? { episodes: [], total: 0 };
  return (
    <TableCard
      title={order === 'worst' ? 'Worst episodes' : 'Newest episodes'}
      id="episodes"
      hint={evaluated ? `${evaluationName(evaluated)} on ${evaluated.traversal}` : undefined}
      name="episodes"
      caption="Episodes"
      of={episodes}
      columns={columns}
      rows={rows}
      rowKey={(e) => e.rowid}
      rowClass={(e) => (e.rowid === replayed ? 'chosen' : undefined)}
      empty={
        <Empty title="No matching episodes">
          {goal === 'missed' && evaluated && evaluated.failed === 0 ? `All ${integer(evaluated.tasks)} tasks were completed (${percent(1)}).` : ''}
        </Empty>
      }
      below={
        <p class="hint">
          {integer(rows.length)} of {integer(total)}.{' '}
          {rows.length < total && limit < 2000 && (
            <button type="button" onClick={() => setParams({ limit: String(limit + 4 * PAGE) })}>
              Show more
            </button>
          )}
        </p>
      }
    >
      <div class="wrap">
        <Choice of={KIND} />
        <Choice of={ORDER} />
        <Choice of={GOAL} />
        {kind === 'evaluation' && all.length > 0 && (
          <Select
            label="Of"
            value={evaluated ? evaluationKey(evaluated) : ''}
            options={[
              { value: '', label: 'every evaluation' },
              ...all.map((one) => ({ value: evaluationKey(one), label: `${evaluationName(one)} on ${one.traversal}` })),
            ]}
            onChange={(value) => setParams({ evaluation: value || null })}
          />
        )}
      </div>
    </TableCard>
  );
}
