// SPDX-License-Identifier: Apache-2.0
import type { Json, Manifest, RunDetail } from '../api/types';

/** Leaves of nested JSON: "parameters.learner.clip" -> "0.2". Lists are leaves. */
export function flatten(value: Json, prefix = '', into = new Map<string, string>()): Map<string, string> {
  if (value !== null && typeof value === 'object' && !Array.isArray(value)) {
    for (const [key, inner] of Object.entries(value)) flatten(inner, prefix ? `${prefix}.${key}` : key, into);
  } else {
    into.set(prefix, Array.isArray(value) ? value.map(text).join(', ') : text(value));
  }
  return into;
}

function text(value: Json): string {
  return typeof value === 'string' ? value : JSON.stringify(value);
}

/** Where a run's files are: the host, and their paths there. */
export interface Artefacts {
  host: string;
  paths: string[];
}

/** Returns what a manifest says of the run's files; null if it says nothing. */
export function artefactsOf(manifest: Manifest | null): Artefacts | null {
  const said = manifest?.artefacts;
  if (said === null || typeof said !== 'object' || Array.isArray(said)) return null;
  const { host, folder, names } = said;
  if (typeof host !== 'string' || typeof folder !== 'string' || !Array.isArray(names)) return null;
  return { host, paths: names.flatMap((name) => (typeof name === 'string' ? [`${folder}/${name}`] : [])) };
}

export interface ManifestRow {
  key: string;
  /** One a manifest; null where it has no such key. */
  values: (string | null)[];
  differs: boolean;
}

/**
 * All keys of several manifests, in the order in which they first stand, but for those of files: see artefactsOf(). A manifest
 * that is not known differs in nothing.
 */
export function compareManifests(manifests: readonly (Manifest | null)[]): ManifestRow[] {
  const leaves = manifests.map((manifest) => (manifest ? flatten({ ...manifest, artefacts: {} }) : null));
  const keys = [...new Set(leaves.flatMap((all) => (all ? [...all.keys()] : [])))];
  return keys.map((key) => {
    const values = leaves.map((all) => all?.get(key) ?? null);
    const known = values.filter((_, i) => leaves[i] !== null);
    return { key, values, differs: new Set(known).size > 1 };
  });
}

/** Returns a number of a run's manifest; null if it has none of that name. */
export function manifestNumber(run: RunDetail | null, key: string): number | null {
  const value = run?.manifest?.[key];
  return typeof value === 'number' ? value : null;
}
