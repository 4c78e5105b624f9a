// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import type { EpisodeDetail, RunDetail } from '../api/types';
import type { Line } from '../maths/curves';
import { evaluationName } from '../maths/evaluations';
import { fixed, integer } from '../maths/format';
import { manifestNumber } from '../maths/manifest';
import { sameTraversal } from '../maths/scene';
import { useJson, valueOf, type Resource } from '../state/resource';
import { param, setParams } from '../state/router';
import { Card, Empty, IconButton, Select, Show } from '../ui/basics';
import { Chart } from '../ui/chart';
import { Pictures, SiblingSelect, siblingsOf } from '../ui/picture';
import { RouteLegend, RouteMap } from '../ui/route_map';

/** Plays the chosen episode step by step. */
export function Replay({ rowid, detail }: { rowid: number; detail: Resource<RunDetail> }): JSX.Element {
  const room = useRef<HTMLDivElement>(null);
  useEffect(() => {
    room.current?.scrollIntoView({ block: 'start' });
  }, []);
  const episode = useJson<EpisodeDetail>(`api/episodes/${rowid}`);
  const shown = valueOf(episode);
  return (
    <div ref={room} id="replay">
      <Card
        title={`Replay of episode ${rowid}`}
        hint={shown ? describe(shown) : undefined}
        actions={
          <button type="button" onClick={() => setParams({ episode: null, step: null })}>
            Close
          </button>
        }
      >
        <Show of={episode} lines={6}>
          {(one) =>
            one.positions?.length ? (
              <Player episode={one} positions={one.positions} run={valueOf(detail)} />
            ) : (
              <Empty title="The actions of this episode were not recorded">
                It has more steps than fit into one message, or the agent slipped or was carried elsewhere, so only its figures were recorded.
              </Empty>
            )
          }
        </Show>
      </Card>
    </div>
  );
}

function describe(one: EpisodeDetail): string {
  const what = one.evaluation ? `task ${one.task}` : 'training';
  const end = one.completed ? `goal reached in ${one.steps} steps, shortest ${one.shortest}` : `goal missed in ${one.steps} steps`;
  return `${evaluationName(one)} on ${one.traversal}, ${what} · ${end} · SPL ${fixed(one.spl, 3)}`;
}

const SPEEDS = ['2', '5', '10', '20', '50'] as const;

/** Plays an episode on the map, with the pictures of the places. */
function Player({ episode, positions, run }: {
  episode: EpisodeDetail;
  positions: readonly number[];
  run: RunDetail | null;
}): JSX.Element {
  const last = positions.length - 1;
  const [step, setStep] = useState(() => Math.min(Math.max(Math.round(Number(param('step', '0')) || 0), 0), last));
  const [playing, setPlaying] = useState(false);
  const speed = SPEEDS.find((one) => one === param('speed', '')) ?? '10';
  const slider = useRef<HTMLInputElement>(null);
  useEffect(() => slider.current?.focus({ preventScroll: true }), []);
  useEffect(() => {
    if (!playing) return undefined;
    const timer = setInterval(() => setStep((now) => Math.min(now + 1, last)), 1000 / Number(speed));
    return () => clearInterval(timer);
  }, [playing, speed, last]);
  // While it plays the address stays, as everything that depends on it would be drawn again with each step.
  useEffect(() => {
    if (!playing) setParams({ step: String(step) });
  }, [playing, step]);
  useEffect(() => {
    if (step === last) setPlaying(false);
  }, [step, last]);
  const toggle = (): void => {
    if (step === last) setStep(0);
    setPlaying(!playing);
  };

  const go = (to: number | null): void => {
    setPlaying(false);
    setStep(to ?? 0);
  };
  const own = run?.traversals.find((one) => sameTraversal(one, episode));
  const [siblings, sibling] = siblingsOf(run?.traversals ?? [], episode);
  const streets = own?.streets ?? false; // where the goal is a place, not a frame
  const least = streets ? 0 : Math.min(...positions, episode.goal);
  const most = streets ? 0 : Math.max(...positions, episode.goal);
  const first = Math.min(manifestNumber(run, 'first_frame') ?? least, least);
  const count = Math.max((manifestNumber(run, 'frames') ?? 0) + first - 1, most) - first + 1;
  const here = positions[step] ?? episode.start;
  const path = useMemo(() => positions.slice(0, step + 1), [positions, step]);
  const lines: Line[] = useMemo(() => {
    const x = positions.map((_, i) => i);
    return [
      { key: 'all', label: 'whole episode', colour: 'series-1', faint: true, x, y: positions },
      { key: 'so far', label: 'so far', colour: 'series-1', x: x.slice(0, step + 1), y: path },
    ];
  }, [positions, path]);
  const walkers = [{ label: `step ${step}`, position: here, start: episode.start, goal: episode.goal }];
  return (
    <div class="stack tight player">
      <div class="row transport">
        <IconButton icon={playing ? 'pause' : 'play'} label={playing ? 'Pause' : 'Play'} onClick={toggle} />
        <input
          ref={slider}
          type="range"
          aria-label="Step"
          min={0}
          max={last}
          step={1}
          value={step}
          aria-valuetext={`step ${step} of ${last}, frame ${here}`}
          onInput={(event) => go(Number(event.currentTarget.value))}
          onKeyDown={(event) => {
            if (event.key !== ' ') return;
            event.preventDefault();
            toggle();
          }}
        />
        <output>
          {step} / {last}
        </output>
        <Select
          label="Steps per second"
          value={speed}
          options={SPEEDS.map((value) => ({ value, label: value }))}
          onChange={(value) => setParams({ speed: value })}
        />
      </div>
      <p class="hint">Space plays and pauses, arrows step, Home and End jump, with the slider in focus.</p>
      {episode.shuffled && (
        <p class="note">Frames were shuffled for this evaluation: the agent saw other pictures than those of the places where it stood.</p>
      )}
      <div class="columns route-columns">
        <div class="stack">
          <RouteMap
            hash={episode.hash}
            first={first}
            count={count}
            walkers={walkers}
            selected={0}
            path={path}
            whole={false}
            label={`Route of ${episode.traversal}, step ${step} at frame ${here}`}
          />
          <RouteLegend />
          {!streets && (
            <Chart
              title="Path"
              hint={`frame over steps, from ${integer(episode.start)} to the goal ${integer(episode.goal)}`}
              name={`episode ${episode.rowid}`}
              xLabel="steps"
              yLabel="frame"
              lines={lines}
              references={[{ label: 'goal', value: episode.goal }]}
              format={integer}
              height={180}
            />
          )}
        </div>
        <div class="stack">
          <Pictures on={own} name={episode.traversal} alt={`Frame of ${episode.traversal}`} frame={here} sibling={sibling} />
          <SiblingSelect siblings={siblings} chosen={sibling} />
        </div>
      </div>
    </div>
  );
}
