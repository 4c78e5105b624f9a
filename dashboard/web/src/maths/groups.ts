// SPDX-License-Identifier: Apache-2.0
import type { Manifest, Run } from '../api/types';
import { dateTime } from './format';
import { isKnown } from './runs';

export type GroupBy = 'sweep' | 'agent';

/** Runs that differ only in their seed, as far as their manifests are known. */
export interface Group {
  key: string;
  label: string;
  runs: Run[];
}

// Options that may differ between seeds of one setting: names of a run and of where it ran.
const NAMES = ['seed', 'job', 'run', 'id', 'folder', 'artefacts'];

/**
 * Returns a text that is equal for runs of the same options but for the seed. Of the traversals only those of the training
 * count: which others were known already when a run began is chance.
 */
export function settingsOf(manifest: Manifest): string {
  const trained = typeof manifest.train === 'string' ? manifest.train.split(', ') : [];
  const options = Object.entries(manifest).filter(([name]) => !NAMES.includes(name) && name !== 'traversals');
  const { traversals } = manifest;
  const data = traversals !== null && typeof traversals === 'object' && !Array.isArray(traversals) ? traversals : {};
  return JSON.stringify([...options, ...trained.map((name) => [name, data[name] ?? null] as const)]);
}

/** Returns the key and the label that runs of one name share: of one policy_service, or of one agent and learner. */
function nameOf(run: Run, by: GroupBy): { key: string; label: string } {
  const kind = [run.agent, run.learner].filter(Boolean).join(' · ') || 'unknown agent';
  if (by === 'agent') return { key: kind, label: kind };
  return { key: JSON.stringify([run.session, run.policy, kind]), label: `${kind} · session ${run.session}` };
}

/** Returns the runs whose name others have too. They are seeds of one setting only if their manifests agree. */
export function namesakes(runs: readonly Run[], by: GroupBy): Run[] {
  const count = new Map<string, number>();
  const keys = runs.map((run) => nameOf(run, by).key);
  for (const key of keys) count.set(key, (count.get(key) ?? 0) + 1);
  return runs.filter((_, i) => (count.get(keys[i] ?? '') ?? 0) > 1);
}

/**
 * Groups runs, which are given newest first, by their name and their settings (run ID -> settingsOf(); runs without count as
 * alike). Each seed is in a group once: a run that repeats one begins another group. Groups are in the order of their newest
 * run, runs in the order of their seeds.
 */
export function groupRuns(runs: readonly Run[], by: GroupBy, settings: ReadonlyMap<string, string> = new Map()): Group[] {
  const named = new Map<string, Group[]>();
  const groupOf = new Map<Run, Group>();
  // The oldest first, so that a group keeps its key when runs join.
  for (const run of [...runs].reverse()) {
    const { key, label } = nameOf(run, by);
    const rivals = named.get(key) ?? [];
    named.set(key, rivals);
    const fits = (group: Group): boolean =>
      group.runs.every((one) => one.seed !== run.seed && settings.get(one.id) === settings.get(run.id));
    let group = rivals.find(fits);
    if (!group) rivals.push((group = { key: rivals.length ? `${key} ${run.id}` : key, label, runs: [] }));
    group.runs.push(run);
    groupOf.set(run, group);
  }
  for (const rivals of named.values())
    if (rivals.length > 1) for (const group of rivals) group.label += ` · ${dateTime(group.runs[0]?.started)}`;
  const groups = [...new Set(runs.flatMap((run) => groupOf.get(run) ?? []))];
  for (const group of groups) group.runs.sort((a, b) => (a.seed ?? 0) - (b.seed ?? 0));
  return groups;
}

/** Returns the first group with a known run, else the first: others have no curves. */
export function preferredGroup(groups: readonly Group[]): Group | undefined {
  return groups.find((group) => group.runs.some(isKnown)) ?? groups[0];
}
