// SPDX-License-Identifier: Apache-2.0
// The time cursor: a point on the axis of the curves, which the address names. Curves mark it; the route and the replay show what
// is recorded of it. While a recording is open, the cursor is where that is: setting the cursor brings the recording there, and the
// address follows it wherever it stands still.

import { computed, effect, signal } from '@preact/signals';
import { useEffect } from 'preact/hooks';
import { runPath } from '../api/client';
import type { Episode, Evaluation, Run, RunMoment } from '../api/types';
import { beyondText, evaluationUntil, momentAt, pointText } from '../maths/moment';
import type { XAxis } from '../maths/rows';
import { AXIS, chosen } from '../ui/choice';
import { changePlayback, playback, playing, spans } from './playback';
import { useJson, valueOf, type Resource } from './resource';
import { arrivals, param, setParams } from './router';
import { useTraining, type Training } from './training';

/** Returns the axis of the curves. */
export function curveAxis(): XAxis {
  return param('x', '') === 'update' ? 'update' : chosen(AXIS);
}

function addressed(): number | null {
  const at = Number(param('at', '') || NaN);
  return Number.isFinite(at) && at >= 0 ? at : null;
}

/** The run that the point of the address is of; null while no page shows one. */
const subject = signal<string | null>(null);
/** A recording was asked to go to the point of the address. */
const asked = signal(false);
/** The last of `arrivals` whose point was asked for, or which had none. */
const heeded = signal(0);
/** What is said where a recording does not reach to the point that was asked for, and the update that stands for it. */
const clamped = signal<{ text: string; run: string; update: number } | null>(null);

/** Says that the recording does not reach to the point that was asked for; empty where it does. */
export const beyond = computed(() => {
  const said = clamped.value;
  return said && playback.value?.runs[said.run]?.update === said.update ? said.text : '';
});

/** Whether a recording is on its way to the point of the address. */
const underWay = (): boolean => asked.value || (playback.value?.seeking ?? false) || (heeded.value !== arrivals.value && addressed() !== null);

/** Returns how far a run is where the open recording is; null if none is open, or it has no update by then. */
function recorded(run: string | null): RunMoment | null {
  return (run !== null && playback.value?.runs[run]) || null;
}

/** Returns the point of the cursor; null for none. */
export function cursorAt(): number | null {
  const moment = recorded(subject.value);
  return playback.value && !underWay() ? (moment && moment[curveAxis()]) : addressed();
}

/** Sets the cursor. What was shown of an earlier one goes, so that the new one's record is shown. A recording always is somewhere: null changes nothing there. */
export function setCursor(at: number | null): void {
  const run = subject.value;
  if (playback.value && (at === null || run === null)) return;
  setParams({ at: at === null ? null : pointText(curveAxis(), Math.max(at, 0)), episode: null, step: null });
  if (playback.value && run !== null && at !== null) seek(run, curveAxis(), at);
}

/** Brings the recording to a point, where it stands still: so the point is what is shown. */
function seek(run: string, x: XAxis, at: number): void {
  const span = spans.value?.[run];
  const text = span ? beyondText(x, at, span) : '';
  clamped.value = span && text ? { text, run, update: at > span.last[x] ? span.last.update : span.first.update } : null;
  asked.value = true;
  void changePlayback({ moment: { run, [x]: at }, paused: true }).then(() => (asked.value = false));
}

/** Keeps the address and the open recording at one point. */
export function startCursor(): void {
  let held: { run: string; update: number } | null = null; // where the recording stood last, since the address came from outside
  effect(() => {
    const now = playback.value;
    // Before the recording was read, it does not know where a moment is.
    if (!now || now.length === null || spans.value === null || asked.value) return;
    const at = addressed();
    const x = curveAxis();
    if (heeded.value !== arrivals.value) {
      const run = param('run', '') || param('runs', '') || (subject.value ?? '');
      if (at !== null && run === '') return; // until a page shows a run
      heeded.value = arrivals.value;
      held = null;
      const here = recorded(run);
      // One that plays through the point does not stand there.
      if (at !== null && (playing.value || !here || pointText(x, here[x]) !== pointText(x, at))) {
        seek(run, x, at);
        return;
      }
    }
    if (now.seeking) return;
    const run = subject.value;
    const moment = recorded(run);
    if (playing.value) {
      clamped.value = null;
      // While it goes on, the address names no moment: loading the page again would bring everybody back there.
      if (run !== null && param('at', '') !== '') setParams({ at: null });
    } else if (run !== null && moment) {
      const text = pointText(x, moment[x]);
      const left = held?.run === run && held.update !== moment.update; // with the episode that was chosen there
      held = { run, update: moment.update };
      if (left || param('at', '') !== text) setParams({ at: text, ...(left && { episode: null, step: null }) });
    }
  });
}

/** Says, while the component is shown, of which run the cursor is. */
export function useCursorOf(run: string | null): void {
  useEffect(() => {
    subject.value = run;
    return () => {
      subject.value = null;
    };
  }, [run]);
}

/** Returns the parameters of a link to the same point. */
export function cursorParams(): Record<string, string> {
  const at = playing.value ? null : cursorAt();
  const x = curveAxis();
  return at === null ? {} : { ...(x !== 'steps' && { x }), at: pointText(x, at) };
}

/** A run at the cursor. */
export interface Seen {
  training: Training | undefined;
  /** Null without a cursor, or if the run has no updates. */
  moment: RunMoment | null;
  /** The moment is not known yet. */
  pending: boolean;
}

/** Returns a run at a point of the curves' axis. */
export function seenAt(run: string | undefined, training: Training | undefined, at: number | null): Seen {
  const coming = playback.value !== null && underWay();
  const known = at === null || run === undefined || coming ? null : (recorded(run) ?? (training ? momentAt(training.rows, curveAxis(), at) : null));
  return { training, moment: known, pending: at !== null && (coming || training?.state === 'loading') };
}

/** Returns how far a run was at the cursor, as far as its figures are known. With `curves` they are fetched without a cursor, too. */
export function useMoment(run: Run, curves = false): Seen {
  useCursorOf(run.id);
  const at = cursorAt();
  const training = useTraining(curves || at !== null ? [run.id] : []).get(run.id);
  return seenAt(run.id, training, at);
}

/** Returns the parameter of the same moment on another axis. */
export function moved({ moment }: Seen, axis: XAxis): { at: string | null } {
  return { at: moment && pointText(axis, moment[axis]) };
}

const MOST_EPISODES = 16;

/** Which episodes of a run. */
interface Wanted {
  kind: 'evaluation' | 'training';
  /** Null: on any traversal. */
  traversal: string | null;
  seen: Seen;
}
const NOTHING: Wanted = { kind: 'training', traversal: null, seen: { training: undefined, moment: null, pending: false } };

/**
 * Returns the newest episodes of a run up to a moment, newest first; without a moment, up to its end. Those of an evaluation are the
 * tasks of the agent's newest one. With null it fetches nothing.
 */
export function useEpisodesUntil(run: Run, wanted: Wanted | null): Resource<{ episodes: Episode[] }> {
  const { kind, traversal, seen: { moment, pending } } = wanted ?? NOTHING;
  const fresh = run.state === 'running' && moment === null ? Math.floor((run.recorded_episodes ?? 0) / 500) : run.state;
  const evaluating = kind === 'evaluation';
  const evaluations = useJson<{ evaluations: Evaluation[] }>(evaluating ? runPath(run.id, '/evaluations') : null, fresh);
  const query = new URLSearchParams({ limit: String(MOST_EPISODES), evaluation: evaluating ? '1' : '0' });
  if (traversal !== null) query.set('traversal', traversal);
  if (!evaluating && moment) query.set('until', String(moment.episodes));
  const list = valueOf(evaluations)?.evaluations;
  const evaluation = list ? evaluationUntil(list, traversal, moment?.update ?? null) : null;
  if (evaluation) for (const name of ['policy', 'update', 'traversal'] as const) query.set(name, String(evaluation[name]));
  if (evaluation) query.set('shuffled', '0');
  const none = evaluating && list !== undefined && evaluation === null;
  const known = evaluating ? evaluation !== null : true;
  const episodes = useJson<{ episodes: Episode[] }>(!wanted || pending || !known ? null : runPath(run.id, `/episodes?${query.toString()}`), fresh);
  if (none && !pending) return { state: 'ready', value: { episodes: [] } };
  return evaluating && evaluations.state === 'failed' ? evaluations : episodes;
}
