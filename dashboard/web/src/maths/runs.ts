// SPDX-License-Identifier: Apache-2.0
import type { Run } from '../api/types';

/** Returns a run's name: its network, its learner, its seed and the session of its services. */
export function runName(run: Pick<Run, 'agent' | 'learner' | 'seed' | 'session'>): string {
  const parts = [run.agent || 'unknown agent', run.learner, run.seed !== null && `seed ${run.seed}`, `session ${run.session}`];
  return parts.filter(Boolean).join(' · ');
}

/** Returns the mean steps per second over the training so far; null before its first update. */
export function meanRate(run: Pick<Run, 'steps' | 'wall'>): number | null {
  return run.steps !== null && run.wall ? run.steps / run.wall : null;
}

/** Returns whether more is known of a run than episodes, which an env_service sends again after their policy_service ended. */
export const isKnown = (run: Run): boolean => run.policy !== null;

/** Returns the newest known run in a state, else the newest. Runs come newest first and are not empty. */
export function preferredRun(runs: readonly Run[], state: Run['state']): Run {
  return runs.find((run) => run.state === state && isKnown(run)) ?? (runs[0] as Run);
}
