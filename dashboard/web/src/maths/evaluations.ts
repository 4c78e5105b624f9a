// SPDX-License-Identifier: Apache-2.0
import type { Evaluation } from '../api/types';

const CONTROLS = ['sequence_filter', 'blind', 'shortest_path'];

/** A yardstick, not an agent that learned. */
export function isControl(one: Pick<Evaluation, 'policy'>): boolean {
  return CONTROLS.includes(one.policy);
}

/** What one evaluation is of: the same on each traversal. */
export function evaluationName(one: Pick<Evaluation, 'policy' | 'update' | 'shuffled'>): string {
  return [one.policy || 'unknown policy', !isControl(one) && `update ${one.update}`, one.shuffled && 'shuffled frames'].filter(Boolean).join(', ');
}

export function evaluationKey(one: Evaluation): string {
  return JSON.stringify([one.policy, one.update, one.shuffled, one.traversal]);
}

/** Agents before controls, the newest checkpoint first, what saw shuffled frames after what did not. */
export function sortEvaluations(list: readonly Evaluation[]): Evaluation[] {
  return [...list].sort(
    (a, b) =>
      CONTROLS.indexOf(a.policy) - CONTROLS.indexOf(b.policy) ||
      a.policy.localeCompare(b.policy) ||
      Number(a.shuffled) - Number(b.shuffled) ||
      b.update - a.update,
  );
}

/** By traversal, in the order in which they first stand. */
export function byTraversal(list: readonly Evaluation[]): Map<string, Evaluation[]> {
  const groups = new Map<string, Evaluation[]>();
  for (const one of sortEvaluations(list)) groups.set(one.traversal, [...(groups.get(one.traversal) ?? []), one]);
  const order = [...new Set(list.map((one) => one.traversal))];
  return new Map(order.map((name) => [name, groups.get(name) ?? []]));
}

/** The agent's own evaluations on frames as they are: the SPL of each checkpoint, a curve a traversal. */
export function checkpoints(list: readonly Evaluation[]): Map<string, Evaluation[]> {
  const own = list.filter((one) => !isControl(one) && !one.shuffled).sort((a, b) => a.update - b.update);
  const groups = byTraversal(own);
  for (const [name, group] of groups) groups.set(name, group.sort((a, b) => a.update - b.update));
  return groups;
}

/** The newest checkpoint's on each traversal. */
export function newest(list: readonly Evaluation[]): Map<string, Evaluation> {
  const result = new Map<string, Evaluation>();
  for (const [name, group] of checkpoints(list)) {
    const last = group[group.length - 1];
    if (last) result.set(name, last);
  }
  return result;
}
