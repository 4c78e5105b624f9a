// SPDX-License-Identifier: Apache-2.0
// What the server sends: docs/reference/dashboard-api.md. Unknown numbers are null, times are seconds since 1970.
import type rows from '../../../api/rows.json';

/** The type of what a row has by example: [0, null] is a number or null, [""] a list of texts. */
type Of<V> = V extends readonly (infer U)[] ? (null extends U ? Of<Exclude<U, null>> | null : Of<U>[]) : V extends object ? { [K in keyof V]: Of<V[K]> } : V;
type Rows = Of<typeof rows>;

export type Run = Rows['run'] & { state: 'running' | 'ended' | 'lost' };

export type Json = null | boolean | number | string | Json[] | { [key: string]: Json };
export type Manifest = { [key: string]: Json };

/** A traversal as one env_service of a run announced it. */
export type RunTraversal = Rows['traversal'];

export interface RunDetail extends Run {
  manifest: Manifest | null;
  traversals: RunTraversal[];
}

export interface TrainingAnswer {
  id: string;
  x: string;
  total: number;
  columns: { [name: string]: (number | null)[] };
  decimated: boolean;
}

export type Episode = Rows['episode'];
export interface EpisodeDetail extends Episode {
  positions: number[] | null;
  hash: string | null;
}

export type Evaluation = Rows['evaluation'];

export type Service = Rows['service'] & { state: 'starting' | 'waiting' | 'running' | 'stopping' | 'failed' | 'stopped' | 'lost' };
export interface Services {
  now: number;
  services: Service[];
}

export type ServiceEvent = Rows['event'] & { kind: 'started' | 'stopped' | 'lost' | 'back' | 'restarted' | 'failed' | 'run' | 'alarm' | 'recording' };

export type TraversalMap = Rows['map'];

export type About = Rows['about'];

/** Header of a `scene:` frame. */
export interface SceneHeader {
  traversal: string;
  hash: string;
  first_frame: number;
  frames: number;
  step: number;
  mode: string | number;
  policy: string;
  agents: number;
  /** Places in each agent's belief. */
  likely?: number;
}
/** Where an agent believed to stand when it chose its last action. */
export interface Belief {
  /** The likeliest frames, the first one first. */
  places: { frame: number; probability: number }[];
  /** Of the whole belief, bits. */
  entropy: number;
  /** The probability that it is not within one place of the likeliest one. */
  lost: number;
}
export interface SceneAgent {
  frame: number;
  position: number;
  start: number;
  goal: number;
  steps: number;
  flags: number;
  belief?: Belief;
}
export interface Scene extends SceneHeader {
  list: SceneAgent[];
}

export const FLAG_FIRST = 1;
export const FLAG_IDLE = 8;
export const LATER_GOAL = 16;
