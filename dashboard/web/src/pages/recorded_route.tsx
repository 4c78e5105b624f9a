// SPDX-License-Identifier: Apache-2.0
import type { ComponentChildren, JSX } from 'preact';
import { useMemo } from 'preact/hooks';
import type { Episode, Run, RunDetail, RunTraversal } from '../api/types';
import { linesOf } from '../maths/curves';
import { evaluationName } from '../maths/evaluations';
import { integer, threeDecimals } from '../maths/format';
import { routePart } from '../maths/scene';
import { curveAxis, cursorAt, moved, setCursor, useEpisodesUntil, useMoment, type Seen } from '../state/cursor';
import { valueOf } from '../state/resource';
import { param, setParams } from '../state/router';
import { Card, Empty, Show, Tick } from '../ui/basics';
import { Chart } from '../ui/chart';
import { AXIS, axisProps, Choice, chosen, KIND, type ChoiceOf } from '../ui/choice';
import { MomentBar } from '../ui/moment_bar';
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

/** Shows what is recorded of a run on a traversal: its curve, and the episodes at the cursor on the map, with pictures. */
export function Recorded({ run, traversal, detail, whole }: RecordedProps): JSX.Element {
  const seen = useMoment(run, true);
  const trained = traversal.traversal === detail.manifest?.train && (run.updates ?? 0) > 0;
  const kinds: ChoiceOf<'evaluation' | 'training'> = trained
    ? { ...KIND, values: { training: KIND.values.training, evaluation: KIND.values.evaluation }, resets: ['episode', 'step'] }
    : { ...KIND, resets: ['episode', 'step'] };
  const kind = chosen(kinds);
  const episodes = useEpisodesUntil(run, { kind, traversal: traversal.traversal, seen });
  const list = valueOf(episodes)?.episodes ?? [];
  const asked = Number(param('episode', '0'));
  const rowid = asked > 0 ? asked : (list[0]?.rowid ?? 0);
  return (
    <>
      <MomentOf run={run} seen={seen} clear={run.state === 'running' ? 'Back to live' : 'Back to the end'}>
        <Choice of={kinds} />
      </MomentOf>
      {rowid > 0 ? (
        <EpisodeCard key={rowid} rowid={rowid} title={(one) => (one ? `Route: ${one.traversal}` : 'Route')} run={detail} whole={whole} />
      ) : (
        <Card title={`Route: ${traversal.traversal}`} hint={`${integer(traversal.frames)} frames`}>
          <Show of={episodes} lines={6}>
            {() => (
              <>
                <p class="note" role="status">
                  No {kind} episode is recorded on {traversal.traversal}
                  {cursorAt() !== null && ' up to this moment'}.
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

/** The cursor of a run: its axis, beside other choices, and what it stands on. */
function MomentOf({ run, seen, clear, children }: { run: Run; seen: Seen; clear: string; children?: ComponentChildren }): JSX.Element {
  return (
    <>
      <div class="wrap card">
        {children}
        <Choice of={{ ...AXIS, also: (axis) => moved(seen, axis) }} />
      </div>
      <MomentBar run={run} seen={seen} clear={clear} />
      <MomentCurve run={run} seen={seen} />
    </>
  );
}

/** The run's SPL, on which the cursor is set. */
function MomentCurve({ run, seen: { training } }: { run: Run; seen: Seen }): JSX.Element | null {
  const x = curveAxis();
  const version = training?.version;
  const lines = useMemo(
    () =>
      training?.rows.length
        ? linesOf(
            [{ key: run.id, label: 'SPL', colour: 'series-1', runs: [{ id: run.id, label: 'SPL', colour: 'series-1', rows: training.rows }] }],
            { metric: 'spl', x, smoothing: 0, display: 'runs', hidden: new Set(), range: null },
          )
        : [],
    [run.id, version, x],
  );
  if (training?.state === 'ready' && training.rows.length === 0) return null;
  return (
    <div class="moment-curve">
      <Chart
        title="SPL in training"
        hint="Click a moment, or press Enter where the arrow keys have moved the cursor: what is recorded of it follows."
        name="spl"
        {...axisProps(x)}
        yLabel="SPL"
        lines={lines}
        format={threeDecimals}
        height={150}
        mark={cursorAt()}
        onMark={setCursor}
        empty={training?.state === 'failed' ? training.error : 'No values yet'}
      />
    </div>
  );
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
      title="Episodes of this moment"
      hint="The newest ones up to the moment that is marked, or of the whole run."
      name={`episodes ${name}`}
      columns={columns}
      rows={list}
      rowKey={(e) => e.rowid}
      rowClass={(e) => (e.rowid === rowid ? 'chosen' : undefined)}
      empty={<Empty title="No episodes" />}
    />
  );
}
