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
 * Groups runs: those of one policy_service with different seeds (`sweep`), or all of one agent and learner (`agent`). A seed
 * that comes again begins another sweep, as its options may have changed. Groups are in the order of their newest run, runs
 * in the order of their seeds.
 */
export function groupRuns(runs: readonly Run[], by: GroupBy): Group[] {
  const groups = new Map<string, Group>();
  const sweeps = new Map<string, number>(); // of one policy_service, by its key
  for (const run of runs) {
    const kind = [run.agent, run.learner].filter(Boolean).join(' · ') || 'unknown agent';
    const of = by === 'sweep' ? JSON.stringify([run.session, run.policy, kind]) : kind;
    let number = sweeps.get(of) ?? 1;
    const name = (): string => (number === 1 ? of : `${of} ${number}`);
    if (by === 'sweep' && groups.get(name())?.runs.some((one) => one.seed === run.seed)) sweeps.set(of, ++number);
    let group = groups.get(name());
    if (!group) {
      const label = by === 'sweep' ? `${kind} · session ${run.session}${number === 1 ? '' : ` (earlier, ${number - 1})`}` : kind;
      groups.set(name(), (group = { key: name(), label, runs: [] }));
    }
    group.runs.push(run);
  }
  for (const group of groups.values())
    group.runs.sort((a, b) => (a.seed ?? 0) - (b.seed ?? 0) || (b.started ?? 0) - (a.started ?? 0));
  return [...groups.values()];
}
