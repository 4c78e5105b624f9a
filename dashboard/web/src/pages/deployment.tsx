// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useMemo } from 'preact/hooks';
import { runPath } from '../api/client';
import type { Episode, Evaluation, Run, RunDetail } from '../api/types';
import { byTraversal, checkpoints, evaluationKey, evaluationName, isControl } from '../maths/evaluations';
import { dateTime, fixed, integer, percent, plural, short } from '../maths/format';
import { useJson, type Resource } from '../state/resource';
import { param, place, setParams } from '../state/router';
import { Card, Empty, Select, Show, State } from '../ui/basics';
import { Chart, type Line } from '../ui/chart';
import { Choice, chosen, type ChoiceOf } from '../ui/choice';
import { CompletedBar, Whisker } from '../ui/marks';
import { chosenRun, RunSelect } from '../ui/run_select';
import { SaveTable, Table, type Column } from '../ui/table';
import { WithRuns } from '../ui/with_runs';
import { Replay } from './replay';

const KIND: ChoiceOf<'evaluation' | 'training'> = { name: 'kind', label: 'Episodes of', values: { evaluation: 'Evaluation', training: 'Training' } };
const ORDER: ChoiceOf<'worst' | 'newest'> = { name: 'order', label: 'Order', values: { worst: 'Worst first', newest: 'Newest first' } };
const GOAL: ChoiceOf<'all' | 'reached' | 'missed'> = { name: 'goal', label: 'Goal', values: { all: 'All', reached: 'Reached', missed: 'Missed' } };

export function Deployment(): JSX.Element {
  return (
    <WithRuns title="Deployment" empty="Evaluations of trained agents and all recorded episodes appear here.">
      {(all) => <DeploymentOf run={chosenRun(all, (run) => run.state === 'ended')} all={all} />}
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
      <div class="controls card">
        <RunSelect runs={all} chosen={run} />
        <p class="run-state">
          <State state={run.state} /> <span class="hint">{plural(run.recorded_episodes ?? 0, 'recorded episode')}</span>
        </p>
      </div>
      {episode > 0 && <Replay key={episode} rowid={episode} detail={detail} />}
      <Show of={evaluations} lines={8}>
        {({ evaluations: list }) =>
          list.length ? (
            <>
              <div class="evaluations">
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

function EvaluationCard({ traversal, list }: { traversal: string; list: readonly Evaluation[] }): JSX.Element {
  const selected = param('evaluation', '');
  const alike = new Set(list.map((one) => one.tasks)).size === 1;
  const columns: Column<Evaluation>[] = [
    { key: 'policy', label: 'Policy', show: evaluationName, cell: evaluationName },
    {
      key: 'completed',
      label: 'Completed',
      show: (e) => <CompletedBar completed={e.completed} />,
      cell: (e) => e.completed,
    },
    { key: 'failed', label: 'Failed', number: true, show: (e) => integer(e.failed * e.tasks), cell: (e) => Math.round(e.failed * e.tasks) },
    {
      key: 'spl',
      label: 'SPL, 95 % interval',
      show: (e) => <Whisker value={e.spl} low={e.spl_low} high={e.spl_high} />,
      cell: (e) => e.spl,
    },
    { key: 'spl_low', label: 'lowest', number: true, show: (e) => fixed(e.spl_low, 3), cell: (e) => e.spl_low },
    { key: 'spl_high', label: 'highest', number: true, show: (e) => fixed(e.spl_high, 3), cell: (e) => e.spl_high },
    { key: 'reward', label: 'Reward', number: true, show: (e) => fixed(e.reward, 3), cell: (e) => e.reward },
    { key: 'mean_steps', label: 'Steps', number: true, show: (e) => fixed(e.mean_steps, 1), cell: (e) => e.mean_steps },
    { key: 'shortest_mean', label: 'Shortest', number: true, show: (e) => fixed(e.shortest_mean, 1), cell: (e) => e.shortest_mean },
    { key: 'excess', label: 'Excess', number: true, show: (e) => fixed(e.excess, 2), cell: (e) => e.excess },
    { key: 'tasks', label: 'Tasks', number: true, show: (e) => integer(e.tasks), cell: (e) => e.tasks },
    {
      key: 'show',
      label: 'Tasks',
      quiet: true,
      show: (e) => (
        <button
          type="button"
          class="small"
          aria-label={`Worst tasks of ${evaluationName(e)} on ${traversal}`}
          onClick={() => {
            setParams({ evaluation: evaluationKey(e), kind: 'evaluation', order: 'worst' });
            document.getElementById('episodes')?.scrollIntoView({ block: 'start' });
          }}
        >
          Worst
        </button>
      ),
    },
  ];
  return (
    <Card
      title={`On ${traversal}`}
      hint={alike ? `${integer(list[0]?.tasks)} tasks each` : undefined}
      actions={<SaveTable name={`evaluations ${traversal}`} columns={columns} rows={list} />}
    >
      <Table
        caption={`Evaluations on ${traversal}`}
        columns={columns.filter(({ key }) => !['spl_low', 'spl_high', alike ? 'tasks' : ''].includes(key))}
        rows={list}
        rowKey={evaluationKey}
        rowClass={(e) => (evaluationKey(e) === selected ? 'chosen' : isControl(e) ? 'past' : undefined)}
      />
    </Card>
  );
}

function Checkpoints({ list }: { list: readonly Evaluation[] }): JSX.Element | null {
  const groups = checkpoints(list);
  const lines: Line[] = useMemo(
    () =>
      [...groups].map(([traversal, group], i) => ({
        key: traversal,
        label: traversal,
        colour: `series-${(i % 8) + 1}`,
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
      lines={lines}
      format={(value) => fixed(value, 3)}
      xFormat={short}
      legend
    />
  );
}

const PAGE = 50;

function Episodes({ run, evaluations, fresh }: {
  run: Run;
  evaluations: Resource<{ evaluations: Evaluation[] }>;
  fresh: unknown;
}): JSX.Element {
  const kind = chosen(KIND);
  const order = chosen(ORDER);
  const goal = chosen(GOAL);
  const limit = Math.min(Math.max(Number(param('limit', String(PAGE))) || PAGE, PAGE), 2000);
  const all = evaluations.state === 'ready' ? evaluations.value.evaluations : [];
  const evaluated = kind === 'evaluation' ? all.find((one) => evaluationKey(one) === param('evaluation', '')) : undefined;
  const query = new URLSearchParams({ limit: String(limit), order, evaluation: kind === 'evaluation' ? '1' : '0' });
  if (evaluated) {
    query.set('traversal', evaluated.traversal);
    query.set('policy', evaluated.policy);
    query.set('update', String(evaluated.update));
    query.set('shuffled', evaluated.shuffled ? '1' : '0');
  }
  if (goal !== 'all') query.set('completed', goal === 'reached' ? '1' : '0');
  const episodes = useJson<{ episodes: Episode[]; total: number }>(runPath(run.id, `/episodes?${query.toString()}`), fresh);
  const replayed = Number(place.value.params.get('episode') ?? 0);
  const columns: Column<Episode>[] = [
    {
      key: 'replay',
      label: 'Replay',
      show: (e) => (
        <button type="button" class="small" aria-label={`${e.evaluation ? `Task ${e.task}` : `Episode ${e.episode}`}: replay, row ${e.rowid}`} onClick={() => setParams({ episode: String(e.rowid) })}>
          {e.evaluation ? `Task ${e.task}` : `Episode ${e.episode}`}
        </button>
      ),
      cell: (e) => e.rowid,
    },
    { key: 'traversal', label: 'Traversal', show: (e) => e.traversal, cell: (e) => e.traversal },
    { key: 'policy', label: 'Policy', show: (e) => evaluationName(e), cell: (e) => evaluationName(e) },
    {
      key: 'completed',
      label: 'Goal',
      show: (e) => <span class={e.completed ? 'reached' : 'missed'}>{e.completed ? 'reached' : 'missed'}</span>,
      cell: (e) => e.completed,
    },
    { key: 'spl', label: 'SPL', number: true, show: (e) => fixed(e.spl, 3), cell: (e) => e.spl },
    { key: 'steps', label: 'Steps', number: true, show: (e) => integer(e.steps), cell: (e) => e.steps },
    { key: 'shortest', label: 'Shortest', number: true, show: (e) => integer(e.shortest), cell: (e) => e.shortest },
    { key: 'reward', label: 'Reward', number: true, show: (e) => fixed(e.reward, 3), cell: (e) => e.reward },
    { key: 'start', label: 'Start', number: true, show: (e) => integer(e.start), cell: (e) => e.start },
    { key: 'goal', label: 'Goal frame', number: true, show: (e) => integer(e.goal), cell: (e) => e.goal },
    { key: 'environment', label: 'Environment', show: (e) => `${e.environment}, agent ${e.agent}`, cell: (e) => e.environment },
    { key: 'recorded', label: 'Recorded', show: (e) => dateTime(e.recorded), cell: (e) => e.recorded },
  ];
  const rows = episodes.state === 'ready' ? episodes.value.episodes : [];
  return (
    <Card
      title={order === 'worst' ? 'Worst episodes' : 'Newest episodes'}
      id="episodes"
      hint={evaluated ? `${evaluationName(evaluated)} on ${evaluated.traversal}` : undefined}
      actions={
        <>
          <a class="hint" href={runPath(run.id, '/episodes.csv')} download>
            All as CSV
          </a>
          <SaveTable name="episodes" columns={columns} rows={rows} />
        </>
      }
    >
      <div class="controls plain">
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
      <Show of={episodes} lines={6}>
        {(answer) =>
          answer.episodes.length ? (
            <>
              <Table
                caption="Episodes"
                columns={columns}
                rows={answer.episodes}
                rowKey={(e) => e.rowid}
                rowClass={(e) => (e.rowid === replayed ? 'chosen' : undefined)}
              />
              <p class="hint table-note">
                {integer(answer.episodes.length)} of {integer(answer.total)}.{' '}
                {answer.episodes.length < answer.total && limit < 2000 && (
                  <button type="button" class="small" onClick={() => setParams({ limit: String(limit + 4 * PAGE) })}>
                    Show more
                  </button>
                )}
              </p>
            </>
          ) : (
            <Empty title="No matching episodes">
              {goal === 'missed' && evaluated && evaluated.failed === 0 ? `All ${integer(evaluated.tasks)} tasks were completed (${percent(1)}).` : ''}
            </Empty>
          )
        }
      </Show>
    </Card>
  );
}
