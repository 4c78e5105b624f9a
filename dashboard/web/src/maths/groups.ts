// SPDX-License-Identifier: Apache-2.0
import type { Run } from '../api/types';

type GroupBy = 'sweep' | 'agent';

/** Runs that differ only in their seed, as far as the grouping knows. */
export interface Group {
  key: string;
  label: string;
  runs: Run[];
}

/**
 * Groups runs: those of one policy_service (`sweep`: certainly the same options), or all of one agent and learner (`agent`).
 * Groups are in the order of their newest run, runs in the order of their seeds.
 */
export function groupRuns(runs: readonly Run[], by: GroupBy): Group[] {
  const groups = new Map<string, Group>();
  for (const run of runs) {
    const kind = [run.agent, run.learner].filter(Boolean).join(' · ') || 'unknown agent';
    const key = by === 'sweep' ? JSON.stringify([run.session, run.policy, kind]) : kind;
    let group = groups.get(key);
    if (!group) groups.set(key, (group = { key, label: by === 'sweep' ? `${kind} · ${run.session}` : kind, runs: [] }));
    group.runs.push(run);
  }
  for (const group of groups.values())
    group.runs.sort((a, b) => (a.seed ?? 0) - (b.seed ?? 0) || (b.started ?? 0) - (a.started ?? 0));
  return [...groups.values()];
}
