// SPDX-License-Identifier: Apache-2.0
import type { Manifest, RunDetail } from '../api/types';

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

/** Returns a number of a run's manifest; null if it has none of that name. */
export function manifestNumber(run: RunDetail | null, key: string): number | null {
  const value = run?.manifest?.[key];
  return typeof value === 'number' ? value : null;
}
