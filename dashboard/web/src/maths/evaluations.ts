// SPDX-License-Identifier: Apache-2.0
import type { Evaluation } from '../api/types';

const CONTROLS = ['blind', 'oracle_filter', 'sequence_filter', 'shortest_path'];

/** Returns whether the policy is a reference that does not learn. */
export function isControl(one: Pick<Evaluation, 'policy'>): boolean {
  return CONTROLS.includes(one.policy);
}

/** Returns the name of an evaluation, the same on each traversal. */
export function evaluationName(one: Pick<Evaluation, 'policy' | 'update' | 'shuffled'>): string {
  return [one.policy || 'unknown policy', !isControl(one) && `update ${one.update}`, one.shuffled && 'shuffled frames'].filter(Boolean).join(', ');
}

export function evaluationKey(one: Evaluation): string {
  return JSON.stringify([one.policy, one.update, one.shuffled, one.traversal]);
}

/** Sorts agents before controls, newest checkpoints first, shuffled frames last. */
function sortEvaluations(list: readonly Evaluation[]): Evaluation[] {
  return [...list].sort(
    (a, b) =>
      CONTROLS.indexOf(a.policy) - CONTROLS.indexOf(b.policy) ||
      a.policy.localeCompare(b.policy) ||
      Number(a.shuffled) - Number(b.shuffled) ||
      b.update - a.update,
  );
}

/** Groups evaluations by traversal, in the order of their first appearance. */
export function byTraversal(list: readonly Evaluation[]): Map<string, Evaluation[]> {
  const groups = new Map<string, Evaluation[]>();
  for (const one of sortEvaluations(list)) groups.set(one.traversal, [...(groups.get(one.traversal) ?? []), one]);
  const order = [...new Set(list.map((one) => one.traversal))];
  return new Map(order.map((name) => [name, groups.get(name) ?? []]));
}

/** Returns the agent's evaluations on unshuffled frames by traversal, oldest checkpoint first. */
export function checkpoints(list: readonly Evaluation[]): Map<string, Evaluation[]> {
  const own = list.filter((one) => !isControl(one) && !one.shuffled).sort((a, b) => a.update - b.update);
  const groups = byTraversal(own);
  for (const [name, group] of groups) groups.set(name, group.sort((a, b) => a.update - b.update));
  return groups;
}

/** Returns the newest checkpoint's evaluation on each traversal. */
export function newest(list: readonly Evaluation[]): Map<string, Evaluation> {
  return new Map([...checkpoints(list)].map(([name, group]) => [name, group.at(-1) as Evaluation]));
}

/**
 * Returns what a policy_service prints at its end: mean SPL by traversal and policy, of agents on their own and on shuffled frames,
 * and of controls. Of each policy it is that of the newest checkpoint, the agent's column first.
 */
export function splMatrix(list: readonly Evaluation[]): { policies: string[]; rows: { traversal: string; spl: Map<string, number> }[] } {
  const columnOf = (one: Evaluation): string => (one.shuffled && !isControl(one) ? `${one.policy}, shuffled frames` : one.policy || 'unknown policy');
  const policies = [...new Set(sortEvaluations(list).map(columnOf))];
  const rows = [...byTraversal(list)].map(([traversal, group]) => {
    // The newest checkpoint of a policy comes first.
    const spl = new Map<string, number>();
    for (const one of group) if (!spl.has(columnOf(one))) spl.set(columnOf(one), one.spl);
    return { traversal, spl };
  });
  return { policies, rows };
}
