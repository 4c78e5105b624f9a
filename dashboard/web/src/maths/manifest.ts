// SPDX-License-Identifier: Apache-2.0
import type { Json, Manifest, RunDetail } from '../api/types';

/** Returns where a manifest says that the run's files are: the host, and their paths there; null if it says nothing. */
export function artefactsOf(manifest: Manifest | null): { host: string; paths: string[] } | null {
  const said = manifest?.artefacts;
  if (said === null || typeof said !== 'object' || Array.isArray(said)) return null;
  const { host, folder, names } = said;
  if (typeof host !== 'string' || typeof folder !== 'string' || !Array.isArray(names)) return null;
  return { host, paths: names.flatMap((name) => (typeof name === 'string' ? [`${folder}/${name}`] : [])) };
}

/** Returns a number of a run's manifest; null if it has none of that name. */
export function manifestNumber(run: RunDetail | null, key: string): number | null {
  const value = run?.manifest?.[key];
  return typeof value === 'number' ? value : null;
}

/** A fact of several runs: an option, or a figure. */
export interface Fact {
  key: string;
  /** One a run; null where it has none. */
  values: readonly (string | null)[];
  differs: boolean;
}

function leafText(value: Json): string {
  if (Array.isArray(value)) return value.map(leafText).join(', ');
  return typeof value === 'string' ? value : JSON.stringify(value);
}

/** Adds the leaves of nested JSON by their names, joined by dots: "learner.clip" -> "0.2". Lists are leaves. */
function addLeaves(leaves: Map<string, string>, value: Json, name: string): void {
  if (value === null || typeof value !== 'object' || Array.isArray(value)) leaves.set(name, leafText(value));
  else for (const [key, inner] of Object.entries(value)) addLeaves(leaves, inner, `${name}.${key}`);
}

/** Returns all options of several runs, by name. Leaves out where files are. A run without a manifest never makes an option differ. */
export function compareManifests(manifests: readonly (Manifest | null)[]): Fact[] {
  const runs = manifests.map((manifest) => {
    const leaves = new Map<string, string>();
    for (const [key, value] of Object.entries(manifest ?? {})) if (key !== 'artefacts') addLeaves(leaves, value, key);
    return leaves;
  });
  const known = runs.filter((leaves) => leaves.size > 0);
  return [...new Set(runs.flatMap((leaves) => [...leaves.keys()]))].sort().map((key) => {
    const values = runs.map((leaves) => leaves.get(key) ?? null);
    return { key, values, differs: new Set(known.map((leaves) => leaves.get(key))).size > 1 };
  });
}
