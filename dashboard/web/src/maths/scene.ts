// SPDX-License-Identifier: Apache-2.0
import type { Belief, RunDetail, RunTraversal, Scene } from '../api/types';
import { integer } from './format';
import { manifestNumber } from './manifest';

const MODES: Record<string, string> = { train: 'training', evaluate: 'evaluating' };

export type Recorded = { traversal: string; hash: string | null };
/** Returns whether both are on one traversal. Two of equal contents have one hash. */
export const sameTraversal = (a: Recorded, b: Recorded): boolean => a.traversal === b.traversal && a.hash === b.hash;

/** Returns the frames that are the route of a scene's agents. Without settings it has none yet: then those of the run's options. */
export function routePart(scene: Scene | null, detail: RunDetail, traversal: RunTraversal): { first: number; count: number } {
  if (scene && scene.frames > 0) return { first: scene.first_frame, count: scene.frames };
  const first = manifestNumber(detail, 'first_frame') ?? 0;
  return { first, count: Math.min(manifestNumber(detail, 'frames') ?? traversal.frames, traversal.frames - first) };
}

/** Describes what an env_service does: its mode and policy, its route, and how far it is. */
export function sceneText(scene: Scene | null, traversal: RunTraversal): string {
  if (!scene) return `${integer(traversal.frames)} frames`;
  const does = [MODES[scene.mode] ?? scene.mode, scene.policy].filter(Boolean).join(' ');
  if (scene.frames === 0) return `${does} · ${integer(traversal.frames)} frames`;
  return `${does} · frames ${integer(scene.first_frame)} to ${integer(scene.first_frame + scene.frames - 1)} · tick ${integer(scene.step)}`;
}

/** Says in words where an agent believes to stand, and how sure it is. */
export function beliefText({ places, entropy, lost }: Belief): string {
  const sure = Math.floor(100 * (1 - lost)); // never surer than it is
  return `sure to ${sure} % that it is within one place of ${integer(places[0]?.frame ?? 0)}; entropy ${entropy.toFixed(1)} bits`;
}
