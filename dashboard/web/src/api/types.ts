// SPDX-License-Identifier: Apache-2.0
// What the server sends: docs/reference/dashboard-api.md. Unknown numbers are null, times are seconds since 1970.

export interface Run {
  id: string;
  session: string;
  policy: string | null;
  seed: number | null;
  agent: string | null;
  learner: string | null;
  state: 'running' | 'ended' | 'lost';
  started: number | null;
  last: number | null;
  updates: number | null;
  steps: number | null;
  episodes: number | null;
  recorded_episodes: number | null;
  reward: number | null;
  spl: number | null;
  wall: number | null;
  steps_per_second: number | null;
  /** As people gave them. */
  tags: string[];
  note: string;
}

export type Json = null | boolean | number | string | Json[] | { [key: string]: Json };
export type Manifest = { [key: string]: Json };

/** A traversal as one env_service of a run announced it. */
export interface RunTraversal {
  environment: string;
  dataset: string;
  traversal: string;
  condition: string;
  hash: string;
  frames: number;
  agents: number;
  images: boolean;
}

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

export interface ControlFigures {
  spl: number;
  reward: number;
  steps: number;
  completed: number;
}
export interface Controls {
  blind: ControlFigures;
  shortest_path: ControlFigures;
}

export interface Episode {
  rowid: number;
  environment: string;
  incarnation: number | string;
  episode: number;
  agent: number;
  evaluation: boolean;
  task: number;
  traversal: string;
  policy: string;
  update: number;
  shuffled: boolean;
  start: number;
  goal: number;
  steps: number;
  shortest: number;
  reward: number;
  completed: boolean;
  spl: number;
  recorded: number;
}
export interface EpisodeDetail extends Episode {
  positions: number[] | null;
  hash: string | null;
}

export interface Evaluation {
  policy: string;
  update: number;
  shuffled: boolean;
  traversal: string;
  tasks: number;
  completed: number;
  failed: number;
  spl: number;
  spl_low: number;
  spl_high: number;
  reward: number;
  mean_steps: number;
  shortest_mean: number;
  excess: number | null;
}

export type ServiceState = 'starting' | 'waiting' | 'running' | 'stopping' | 'failed' | 'stopped' | 'lost';
export interface Service {
  id: string;
  service: string;
  session: string;
  host: string;
  process: number;
  middleware: string;
  incarnation: number | string;
  state: ServiceState;
  activity: string;
  uptime: number | null;
  rate: number | null;
  age: number | null;
  /** Processors kept busy since the heartbeat before. */
  processors: number | null;
  /** Bytes, resident. */
  memory: number | null;
  sent_bytes: number | null;
  received_bytes: number | null;
  received: number | null;
  repeated: number | null;
  resent: number | null;
  rejected: number | null;
  foreign: number | null;
  /** A fault that lasts until somebody acts; empty when there is none. */
  alarm: string;
  since: number | null;
}
export interface Services {
  now: number;
  services: Service[];
}

export type EventKind = 'started' | 'stopped' | 'lost' | 'back' | 'restarted' | 'failed' | 'run' | 'alarm';
export interface ServiceEvent {
  time: number;
  session: string;
  service: string;
  kind: EventKind;
  text: string;
}

export interface TraversalMap {
  hash: string;
  frames: number;
  position: (number | null)[];
  latitude: (number | null)[] | null;
  longitude: (number | null)[] | null;
}

/** One row of what `citylearn vpr` wrote (results.json). */
export interface RecognitionRow {
  encoder: string;
  name: string;
  dimension: number;
  pca: boolean;
  centring: string;
  whitening: number;
  method: string;
  query: string;
  condition: string;
  references: number;
  queries: number;
  tolerance: number;
  recall_1: number | null;
  recall_1_interval: [number, number];
  recall_5: number | null;
  recall_10: number | null;
  auc: number;
  auc_interval: [number, number];
  recall_at_full_precision: number;
  encode_seconds: number;
  seconds: number;
}
export interface Recognition {
  name: string;
  file: string;
  program?: string;
  command?: string;
  dataset?: string;
  reference?: string;
  ground_truth?: string;
  measure?: string;
  rows?: RecognitionRow[];
  /** Files with similarities, for GET .../matrix?file=. */
  matrices?: string[];
  /** Why the summary cannot be read. */
  error?: string;
}

/** Precision over recall of one row of a Recognition. */
export interface RecognitionCurve {
  encoder: string;
  dimension: number;
  centring: string;
  method: string;
  query: string;
  auc: number;
  recall: number[];
  precision: number[];
}

export interface About {
  version: string;
  vendor: string;
  session: string;
  domain: number;
  store: { file: string; bytes: number; episodes: number };
  recording: boolean;
}

/** How far a run is: values of all axes of its curves. `wall` is in seconds of training. */
export interface RunMoment {
  update: number;
  steps: number;
  episodes: number;
  wall: number;
}
/** The first and the last moment of a run that a recording has. */
export interface MomentSpan {
  first: RunMoment;
  last: RunMoment;
}

/** How an open recording is played. */
export interface Playback {
  /** Seconds since its beginning. */
  position: number;
  /** Seconds; null while the recording is being read for it. */
  length: number | null;
  speed: number | 'max';
  paused: boolean;
  /** On its way to a position, as fast as it can. */
  seeking: boolean;
  ended: boolean;
  /** How often an earlier position was asked for. What was fetched before is not of this time. */
  generation: number;
  /** How far the runs are at the position, by their IDs. */
  runs: { [run: string]: RunMoment };
}
export interface PlaybackAnswer extends Playback {
  /** How many there are in each hundredth of the recording. */
  marks: { updates: number[]; episodes: number[] } | null;
  spans: { [run: string]: MomentSpan } | null;
}
/** `moment` is a position, too: that of a run's update that is nearest to a point of an axis. */
export type PlaybackChange = Partial<Pick<Playback, 'position' | 'speed' | 'paused'>> & { moment?: { run: string } & Partial<RunMoment> };

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
}
export interface SceneAgent {
  frame: number;
  position: number;
  start: number;
  goal: number;
  steps: number;
  flags: number;
}
export interface Scene extends SceneHeader {
  list: SceneAgent[];
}

export const FLAG_FIRST = 1;
export const FLAG_IDLE = 8;
