// SPDX-License-Identifier: Apache-2.0
// The time cursor: a point on the axis of the curves, which the address names. Curves mark it; the route and the replay show what
// is recorded of it.

import { runPath } from '../api/client';
import type { Episode, Evaluation, Run, RunMoment } from '../api/types';
import { evaluationUntil, momentAt, pointText } from '../maths/moment';
import type { XAxis } from '../maths/rows';
import { AXIS, chosen } from '../ui/choice';
import { useJson, valueOf, type Resource } from './resource';
import { param, setParams } from './router';
import { useTraining, type Training } from './training';

/** Returns the axis of the curves. */
export function curveAxis(): XAxis {
  return param('x', '') === 'update' ? 'update' : chosen(AXIS);
}

/** Returns the point of the cursor; null for none. */
export function cursorAt(): number | null {
  const at = Number(param('at', '') || NaN);
  return Number.isFinite(at) && at >= 0 ? at : null;
}

/** Sets the cursor. What was shown of an earlier one goes, so that the new one's record is shown. */
export function setCursor(at: number | null): void {
  setParams({ at: at === null ? null : pointText(curveAxis(), Math.max(at, 0)), episode: null, step: null });
}

/** Returns the parameters of a link to the same point. */
export function cursorParams(): Record<string, string> {
  const at = cursorAt();
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
export function seenAt(training: Training | undefined, at: number | null): Seen {
  const moment = at === null || !training ? null : momentAt(training.rows, curveAxis(), at);
  return { training, moment, pending: at !== null && training?.state === 'loading' };
}

/** Returns how far a run was at the cursor, as far as its figures are known. With `curves` they are fetched without a cursor, too. */
export function useMoment(run: Run, curves = false): Seen {
  const at = cursorAt();
  return seenAt(useTraining(curves || at !== null ? [run.id] : []).get(run.id), at);
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
