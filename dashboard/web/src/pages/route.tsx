// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { runPath } from '../api/client';
import { sceneOf } from '../api/frame';
import { live } from '../api/live';
import type { Run, RunDetail, RunTraversal, Scene } from '../api/types';
import type { Line } from '../maths/curves';
import { integer } from '../maths/format';
import { beliefText, routePart, sceneText } from '../maths/scene';
import { idle, laterGoals, Trails, type Trail } from '../maths/trail';
import { useJson, valueOf } from '../state/resource';
import { hrefOf, param, setParams } from '../state/router';
import { now } from '../state/shared';
import { seriesColour } from '../state/theme';
import { Card, Empty, Select, Show, Swatch, Tick } from '../ui/basics';
import { Chart } from '../ui/chart';
import { Choice, chosen, type ChoiceOf } from '../ui/choice';
import { Pictures, SiblingSelect, siblingsOf } from '../ui/picture';
import { RouteLegend, RouteMap, type Walker } from '../ui/route_map';
import { chosenRun, RunSelect } from '../ui/run_select';
import { TableCard, text, type Column } from '../ui/table';
import { WithRuns } from '../ui/with_runs';

const VIEW: ChoiceOf<'route' | 'whole'> = { name: 'view', label: 'Show', values: { route: 'Route', whole: 'Whole traversal' } };

export function RoutePage(): JSX.Element {
  return (
    <WithRuns title="Route" empty="The route, its agents and what they see appear here as soon as a policy_service runs.">
      {(all) => <RouteOf run={chosenRun(all, 'running')} all={all} />}
    </WithRuns>
  );
}

/** Returns an env_service's newest scene, its agents' trails, and when it arrived (milliseconds since 1970). */
function useScene(topic: string | null): { scene: Scene | null; trails: Trails; came: number } {
  const [state, setState] = useState<{ scene: Scene | null; came: number }>({ scene: null, came: 0 });
  const trails = useRef(new Trails());
  useEffect(() => {
    trails.current = new Trails();
    setState({ scene: null, came: Date.now() });
    if (topic === null) return undefined;
    return live.watch(topic, (frame) => {
      const scene = sceneOf(frame);
      trails.current.add(scene);
      setState({ scene, came: Date.now() });
    });
  }, [topic]);
  return { ...state, trails: trails.current };
}

function RouteOf({ run, all }: { run: Run; all: readonly Run[] }): JSX.Element {
  // Traversals are announced after the run has begun: fetch them again at each update until there are some.
  const [again, setAgain] = useState(0);
  const detail = useJson<RunDetail>(runPath(run.id), `${run.state} ${again}`);
  const traversals = valueOf(detail)?.traversals ?? [];
  const none = detail.state === 'ready' && traversals.length === 0;
  useEffect(() => {
    if (none) setAgain(run.updates ?? 0);
  }, [none, run.updates]);
  // Of a run that is over, the traversal it was trained on comes first.
  const trained = valueOf(detail)?.manifest?.train;
  const first = run.state === 'running' ? undefined : traversals.find((one) => one.traversal === trained);
  const traversal = traversals.find((one) => one.environment === param('env', '')) ?? first ?? traversals[0];
  return (
    <>
      <div class="wrap card">
        <RunSelect runs={all} chosen={run} />
        {traversal && (
          <Select
            label="Traversal"
            value={traversal.environment}
            options={traversals.map((one) => ({ value: one.environment, label: `${one.traversal} (${one.environment})` }))}
            onChange={(env) => setParams({ env, agent: null, episode: null, step: null })}
          />
        )}
        <Choice of={VIEW} />
      </div>
      <Show of={detail} lines={6}>
        {(value) =>
          traversal && run.state === 'running' ? (
            <Scenery run={run} traversal={traversal} all={traversals} detail={value} whole={chosen(VIEW) === 'whole'} />
          ) : traversal ? (
            <Place run={run} traversal={traversal} detail={value} whole={chosen(VIEW) === 'whole'} />
          ) : (
            <Card title="Route">
              <Empty title="No traversals known">env_services announce their traversal when they start.</Empty>
            </Card>
          )
        }
      </Show>
    </>
  );
}

/** The map of a run that is over, with the pictures of its first place. */
function Place({ run, traversal, detail, whole }: {
  run: Run;
  traversal: RunTraversal;
  detail: RunDetail;
  whole: boolean;
}): JSX.Element {
  const { first, count } = routePart(null, detail, traversal);
  return (
    <Card title={`Route: ${traversal.traversal}`} hint={`${integer(traversal.frames)} frames`}>
      <p class="note">
        This run is over. <a href={hrefOf('deployment', { run: run.id })}>Deployment</a> replays its episodes.
      </p>
      <div class="columns route-columns">
        <RouteMap hash={traversal.hash} first={first} count={count} walkers={[]} selected={0} path={[]} whole={whole} label={`Route of ${traversal.traversal}`} />
        <Pictures on={traversal} name={traversal.traversal} alt={`Frame of ${traversal.traversal}`} frame={first} sibling={undefined} />
      </div>
    </Card>
  );
}

function Scenery({ run, traversal, all, detail, whole }: {
  run: Run;
  traversal: RunTraversal;
  all: readonly RunTraversal[];
  detail: RunDetail;
  whole: boolean;
}): JSX.Element {
  const source = `${traversal.environment}@${run.session}`;
  const { scene, trails, came } = useScene(`scene:${source}`);
  const agent = Math.min(Number(param('agent', '0')) || 0, Math.max((scene?.list.length ?? 1) - 1, 0));
  const walkers: Walker[] = useMemo(
    () => (scene?.list ?? []).map((one, i) => ({ ...one, label: `agent ${i}`, idle: idle(one) })),
    [scene],
  );
  const trail = trails.of(agent);
  const here = scene?.list[agent];
  const believes = (scene?.likely ?? 0) > 0;
  const { first, count } = routePart(scene, detail, traversal);
  const silent = Math.floor((now.value - came) / 1000);
  return (
    <div class="columns route-columns">
      <div class="stack">
        <Card title={`Route: ${traversal.traversal}`} hint={sceneText(scene, traversal)}>
          {silent >= 3 && (
            <p class="note" role="status">
              {scene ? `No news for ${silent} s: ` : 'No agent has moved yet: '}
              {traversal.environment} is not in use now, or it has stopped.
            </p>
          )}
          <RouteMap
            hash={traversal.hash}
            first={first}
            count={count}
            walkers={walkers}
            selected={agent}
            path={trail?.positions ?? []}
            heat={here && !idle(here) ? here.belief?.places : undefined}
            onSelect={(one) => setParams({ agent: String(one) })}
            whole={whole}
            label={`Route of ${traversal.traversal} with ${walkers.length} agents`}
          />
          <RouteLegend belief={believes} />
          {here && believes && (
            <p class="hint">
              Agent {agent} {here.belief && !idle(here) ? `is ${beliefText(here.belief)}` : 'is not on its way'}.
            </p>
          )}
        </Card>
        {!traversal.streets && <WalkChart trail={trail} agent={agent} goal={here?.goal ?? null} name={`${traversal.traversal} agent ${agent}`} />}
      </div>
      <div class="stack">
        <Eyes key={source} source={source} traversal={traversal} all={all} agent={agent} frame={here?.frame ?? null} />
        <Agents scene={scene} agent={agent} name={traversal.traversal} streets={traversal.streets} />
      </div>
    </div>
  );
}

function WalkChart({ trail, agent, goal, name }: { trail: Trail | undefined; agent: number; goal: number | null; name: string }): JSX.Element {
  const length = trail?.steps.length ?? 0;
  const lines: Line[] = useMemo(
    () =>
      trail
        ? [{ key: 'walk', label: `agent ${agent}`, colour: seriesColour(agent), x: trail.steps.slice(), y: trail.positions.slice() }]
        : [],
    [trail, length, agent],
  );
  return (
    <Chart
      title={`Path of agent ${agent}`}
      hint="frame over steps of its episode, as far as observed"
      name={name}
      xLabel="steps"
      yLabel="frame"
      lines={lines}
      references={goal === null ? [] : [{ label: 'goal', value: goal }]}
      format={integer}
      height={180}
      empty="No agent activity"
    />
  );
}

/** Shows what the agent sees, and the same place on a sibling traversal. */
function Eyes({ source, traversal, all, agent, frame }: {
  source: string;
  traversal: RunTraversal;
  all: readonly RunTraversal[];
  agent: number;
  frame: number | null;
}): JSX.Element {
  const [siblings, sibling] = siblingsOf(all, traversal);
  return (
    <Card
      title={`What agent ${agent} sees`}
      actions={<SiblingSelect siblings={siblings} chosen={sibling} />}
    >
      <Pictures
        on={traversal}
        name={traversal.traversal}
        alt={`What agent ${agent} sees on ${traversal.traversal}`}
        frame={frame}
        topic={`picture:${source}:${agent}`}
        sibling={sibling}
      />
    </Card>
  );
}

const withLater = (goal: number, later: number): string => (later > 0 ? `${goal}, then ${later} more` : String(goal));

function Agents({ scene, agent, name, streets }: {
  scene: Scene | null;
  agent: number;
  name: string;
  streets: boolean;
}): JSX.Element {
  const rows = (scene?.list ?? []).map((one, i) => ({ ...one, agent: i, left: Math.abs(one.goal - one.position) }));
  const columns: Column<(typeof rows)[number]>[] = [
    {
      ...text('agent', 'Agent'),
      show: (row) => (
        <Tick type="radio" checked={row.agent === agent} onChange={() => setParams({ agent: String(row.agent) })}>
          <Swatch colour={seriesColour(row.agent)} />
          {row.agent}
        </Tick>
      ),
    },
    { ...text('position', 'At'), number: true, show: (row) => (idle(row) ? 'idle' : row.position) },
    { ...text('start', 'Start'), number: true },
    { ...text('goal', 'Goal'), number: true, show: (row) => withLater(row.goal, laterGoals(row)) },
    ...(streets ? [] : [{ ...text('left', 'To go'), number: true }]),
    { ...text('steps', 'Steps'), number: true },
  ];
  return (
    <TableCard
      title="Agents"
      name={`agents ${name}`}
      caption="Agents of this env_service"
      columns={columns}
      rows={rows}
      rowKey={(row) => row.agent}
      rowClass={(row) => (row.agent === agent ? 'chosen' : undefined)}
      empty={<Empty title="No agents yet" />}
    />
  );
}
