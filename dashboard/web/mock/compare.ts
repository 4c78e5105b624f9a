// SPDX-License-Identifier: Apache-2.0
import type { Comparison, Json, Manifest } from '../src/api/types';

/** Leaves of nested JSON: "parameters.learner.clip" -> "0.2". Lists are leaves. */
function flatten(value: Json, prefix = '', into = new Map<string, string>()): Map<string, string> {
  if (value !== null && typeof value === 'object' && !Array.isArray(value)) {
    for (const [key, inner] of Object.entries(value)) flatten(inner, prefix ? `${prefix}.${key}` : key, into);
  } else {
    into.set(prefix, typeof value === 'string' ? value : JSON.stringify(value));
  }
  return into;
}

/** Imitates GET /api/compare. */
export function compared(manifests: readonly Manifest[]): Comparison {
  const leaves = manifests.map((manifest) => flatten({ ...manifest, artefacts: {} }));
  const keys = [...new Set(leaves.flatMap((all) => [...all.keys()]))].sort();
  const config = keys.map((key) => {
    const values = leaves.map((all) => all.get(key) ?? null);
    return { key, values, differs: new Set(values).size > 1 };
  });
  return { config, figures: [] };
}
