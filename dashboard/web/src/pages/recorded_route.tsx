// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { runPath } from '../api/client';
import type { Episode, Evaluation, Run, RunDetail, RunTraversal } from '../api/types';
import { evaluationName, newest } from '../maths/evaluations';
import { integer } from '../maths/format';
import { routePart } from '../maths/scene';
import { useJson, valueOf, type Resource } from '../state/resource';
import { param, setParams } from '../state/router';
import { Card, Empty, Show, Tick } from '../ui/basics';
import { Choice, chosen, KIND, type ChoiceOf } from '../ui/choice';
import { Pictures } from '../ui/picture';
import { RouteMap } from '../ui/route_map';
import { TableCard, text, type Column } from '../ui/table';
import { EpisodeCard, OUTCOME, TASK } from './replay';

interface RecordedProps {
  run: Run;
  traversal: RunTraversal;
  detail: RunDetail;
  whole: boolean;
}

/** Shows what is recorded of a run on a traversal: its newest episodes on the map, with pictures. */
export function Recorded({ run, traversal, detail, whole }: RecordedProps): JSX.Element {
  const trained = traversal.traversal === detail.manifest?.train && (run.updates ?? 0) > 0;
  const kinds: ChoiceOf<'evaluation' | 'training'> = trained
    ? { ...KIND, values: { training: KIND.values.training, evaluation: KIND.values.evaluation }, resets: ['episode', 'step'] }
    : { ...KIND, resets: ['episode', 'step'] };
  const kind = chosen(kinds);
  const episodes = useEpisodes(run, kind, traversal.traversal);
  const list = valueOf(episodes)?.episodes ?? [];
  const asked = Number(param('episode', '0'));
  const rowid = asked > 0 ? asked : (list[0]?.rowid ?? 0);
  return (
    <>
      <div class="wrap card">
        <Choice of={kinds} />
      </div>
      {rowid > 0 ? (
        <EpisodeCard key={rowid} rowid={rowid} title={(one) => (one ? `Route: ${one.traversal}` : 'Route')} run={detail} whole={whole} />
      ) : (
        <Card title={`Route: ${traversal.traversal}`} hint={`${integer(traversal.frames)} frames`}>
          <Show of={episodes} lines={6}>
            {() => (
              <>
                <p class="note" role="status">
                  No {kind} episode is recorded on {traversal.traversal}.
                </p>
                <Place traversal={traversal} detail={detail} whole={whole} />
              </>
            )}
          </Show>
        </Card>
      )}
      <Episodes list={list} chosen={rowid} kind={kind} name={traversal.traversal} />
    </>
  );
}

const MAX_EPISODES = 16;

/** Returns the newest episodes of a run on a traversal, newest first; of evaluations the tasks of the agent's newest one. */
function useEpisodes(run: Run, kind: 'evaluation' | 'training', traversal: string): Resource<{ episodes: Episode[] }> {
  const evaluating = kind === 'evaluation';
  const evaluations = useJson<{ evaluations: Evaluation[] }>(evaluating ? runPath(run.id, '/evaluations') : null, run.state);
  const evaluation = newest(valueOf(evaluations)?.evaluations ?? []).get(traversal);
  const query = new URLSearchParams({ limit: String(MAX_EPISODES), evaluation: evaluating ? '1' : '0', traversal });
  if (evaluation) for (const name of ['policy', 'update'] as const) query.set(name, String(evaluation[name]));
  if (evaluation) query.set('shuffled', '0');
  const episodes = useJson<{ episodes: Episode[] }>(evaluating && !evaluation ? null : runPath(run.id, `/episodes?${query.toString()}`), run.state);
  if (!evaluating || evaluation) return episodes;
  return evaluations.state === 'ready' ? { state: 'ready', value: { episodes: [] } } : evaluations;
}

/** The map without agents, with the pictures of its first place. */
function Place({ traversal, detail, whole }: Omit<RecordedProps, 'run'>): JSX.Element {
  const { first, count } = routePart(null, detail, traversal);
  return (
    <div class="columns route-columns">
      <RouteMap hash={traversal.hash} first={first} count={count} walkers={[]} selected={0} path={[]} whole={whole} label={`Route of ${traversal.traversal}`} />
      <Pictures on={traversal} name={traversal.traversal} alt={`Frame of ${traversal.traversal}`} frame={first} sibling={undefined} />
    </div>
  );
}

function Episodes({ list, chosen: rowid, kind, name }: {
  list: readonly Episode[];
  chosen: number;
  kind: 'evaluation' | 'training';
  name: string;
}): JSX.Element {
  const columns: Column<Episode>[] = [
    {
      key: 'episode',
      label: 'Episode',
      cell: (e) => e.rowid,
      show: (e) => (
        <Tick type="radio" checked={e.rowid === rowid} onChange={() => setParams({ episode: String(e.rowid), step: null })}>
          {e.evaluation ? `task ${e.task}` : integer(e.episode)}
        </Tick>
      ),
    },
    // In training it is that of the run, and what acts changes within an episode.
    ...(kind === 'evaluation' ? [{ key: 'policy', label: 'Policy', cell: evaluationName }] : []),
    text('agent', 'Agent'),
    ...OUTCOME,
    ...TASK,
  ];
  return (
    <TableCard
      title="Episodes"
      hint="The newest ones of the run."
      name={`episodes ${name}`}
      columns={columns}
      rows={list}
      rowKey={(e) => e.rowid}
      rowClass={(e) => (e.rowid === rowid ? 'chosen' : undefined)}
      empty={<Empty title="No episodes" />}
    />
  );
}
