// SPDX-License-Identifier: Apache-2.0
import type { ControlFigures, Episode, EpisodeDetail, Evaluation, EventKind, Manifest, Recognition, RecognitionCurve, Run, RunTraversal, Service, ServiceEvent, TraversalMap } from '../src/api/types';
import { Random } from './random';

// A cluster that trains: several runs and their past, services that come and go, agents on a route. All of it is drawn from
// seeds; the shapes are those of real runs.

export const FIRST = 17;
export const PLACES = 128;
const FRAMES = 1000;
const MAX_STEPS = 128;
const NAMES = ['summer', 'fall', 'winter', 'night'] as const;
const HASHES = ['8c4635a1bbce08e9', '51f0c3a2907de411', 'd07be4c19a35f862', '2b9917aa60cd3e5f'] as const;

export interface Traversal {
  name: string;
  hash: string;
  images: boolean;
  map: TraversalMap;
}

/** A winding line, 22 m a frame. Only the first two have coordinates; the last has neither positions nor pictures. */
function traversals(): Traversal[] {
  const frames = Array.from({ length: FRAMES }, (_, i) => i);
  return NAMES.map((name, t) => ({
    name,
    hash: HASHES[t] as string,
    images: t < 3,
    map: {
      hash: HASHES[t] as string,
      frames: FRAMES,
      position: frames.map((i) => (t < 3 ? 22 * i : null)),
      latitude: t < 2 ? frames.map((i) => 67.28 + 1.2e-4 * i + 8e-3 * Math.sin(i / 90) + t * 1e-5) : null,
      longitude: t < 2 ? frames.map((i) => 14.4 + 3e-4 * i + 0.02 * Math.sin(i / 140)) : null,
    },
  }));
}

interface Plan {
  session: string;
  policy: string;
  seed: number;
  agent: string;
  learner: string;
  updates: number;
  stepsEach: number;
  rate: number; // steps per second
  reward: [number, number]; // at the beginning and in the end
  spl: [number, number];
  tau: number; // steps in which most is learned
  state: Run['state'];
  ago: number; // seconds since it started
}

function plans(): Plan[] {
  const base = { policy: 'policy', seed: 1, agent: 'place_filter', learner: 'ppo', state: 'ended' as Run['state'] };
  const seeds = (count: number, plan: (seed: number) => Omit<Plan, 'seed'>): Plan[] =>
    Array.from({ length: count }, (_, i) => ({ ...plan(i + 1), seed: i + 1 }));
  return [
    ...seeds(4, (seed) => ({ ...base, session: 'demo-2211', updates: seed === 4 ? 60 : 90, stepsEach: 512, rate: 4800, reward: [-0.55, 0.985 + 0.003 * seed], spl: [0.05, 0.97 + 0.006 * seed], tau: 7000 + 1500 * seed, state: seed === 4 ? 'running' : 'ended', ago: 110 - 20 * seed })),
    { ...base, session: 'relabel-1907', learner: 'relabel', updates: 200, stepsEach: 256, rate: 9000, reward: [-0.4, 0.99], spl: [0.08, 0.985], tau: 5000, ago: 5400 },
    ...seeds(5, (seed) => ({ ...base, session: 'features-1830', agent: 'features', updates: 120, stepsEach: 2048, rate: 8800, reward: [-0.7, 0.93 + 0.008 * seed], spl: [0.02, 0.88 + 0.018 * seed], tau: 45_000 + 9000 * (seed % 3), ago: 9000 - 60 * seed })),
    { ...base, session: 'pixels-0412', policy: 'learner', agent: 'raw_images', learner: 'vtrace', updates: 12_000, stepsEach: 512, rate: 3100, reward: [-0.8, 0.9], spl: [0.01, 0.87], tau: 1_500_000, state: 'lost', ago: 90_000 },
  ];
}

const average = (values: readonly number[]): number => values.reduce((a, b) => a + b, 0) / values.length;

/** Draws a start and a different goal. */
function task(random: Random): [number, number] {
  const start = FIRST + random.below(PLACES);
  const goal = FIRST + random.below(PLACES - 1);
  return [start, goal >= start ? goal + 1 : goal];
}

/** Walks towards the goal with probability `skill`, else the other way or nowhere. Returns the places stood at. */
function walk(start: number, goal: number, skill: number, random: Random): number[] {
  const positions = [start];
  for (let at = start; at !== goal && positions.length <= MAX_STEPS; positions.push(at)) {
    const luck = random.next();
    const towards = Math.sign(goal - at);
    at += luck < skill ? towards : luck < skill + (1 - skill) * 0.7 ? -towards : 0;
    at = Math.min(Math.max(at, FIRST), FIRST + PLACES - 1);
  }
  return positions;
}

export class RunData {
  readonly id: string;
  readonly columns: Record<string, number[]> = {};
  length = 0;
  private readonly random: Random;
  private recorded: EpisodeDetail[] | null = null;
  private noise = 0;

  constructor(
    readonly plan: Plan,
    readonly index: number,
    readonly all: Traversal[],
    readonly now: number,
  ) {
    this.id = `${plan.session}/${plan.policy}/${plan.seed}/${1_763_740_800_000_000 + index}`;
    this.random = new Random(100 + index);
    while (this.length < plan.updates) this.update();
  }

  /** One more update. */
  update(): void {
    const { plan, random } = this;
    const n = this.length + 1;
    const last = (name: string): number => this.columns[name]?.[n - 2] ?? 0;
    const share = 1 - Math.exp((-n * plan.stepsEach) / plan.tau);
    const shaken = (value: number, by = 0.4): number => Math.abs(value * (1 + by * random.normal()));
    this.noise = 0.9 * this.noise + random.normal() * 0.012;
    const level = ([from, to]: [number, number]): number => Math.min(1, from + (to - from) * share + this.noise * (1.3 - share));
    const spl = Math.max(0, level(plan.spl));
    const row = {
      update: n,
      steps: n * plan.stepsEach,
      episodes: last('episodes') + Math.max(1, Math.round((plan.stepsEach * Math.max(spl, 0.35)) / 43)),
      lesson: plan.learner === 'vtrace' ? Math.min(6, Math.floor((7 * n) / plan.updates)) : 0,
      wall: last('wall') + plan.stepsEach / plan.rate,
      steps_per_second: shaken(plan.rate, 0.05),
      reward: n === 1 ? NaN : level(plan.reward),
      spl: n === 1 ? NaN : spl,
      episode_length: n === 1 ? NaN : MAX_STEPS - (MAX_STEPS - 43) * share,
      policy_loss: -0.002 * (1 - share) + 0.001 * random.normal(),
      value_loss: shaken(0.03 * (1.1 - share), 0.2),
      entropy: 1.0986 - 0.78 * share + 0.02 * random.normal(),
      approx_kl: shaken(0.004 * (1.2 - share)),
      clip_fraction: shaken(0.06 * (1.1 - share)),
      gradient_norm: 4 + 20 * (1.05 - share) + random.normal(),
      learning_rate: 0.003 * Math.max(0.02, 1 - n / (plan.state === 'running' ? 4000 : plan.updates)),
      policy_lag: plan.learner === 'vtrace' ? shaken(1.4, 0.2) : 0,
    };
    for (const [name, value] of Object.entries(row)) (this.columns[name] ??= []).push(value);
    this.length = n;
  }

  last(name: string): number | null {
    const value = this.columns[name]?.[this.length - 1];
    return value === undefined || Number.isNaN(value) ? null : value;
  }

  summary(): Run {
    const { session, policy, seed, agent, learner, state, ago } = this.plan;
    const started = this.now - ago;
    const figures = { steps: this.last('steps'), episodes: this.last('episodes'), reward: this.last('reward'), spl: this.last('spl'), wall: this.last('wall'), steps_per_second: this.last('steps_per_second') };
    const last = state === 'running' ? Date.now() / 1000 : started + (figures.wall ?? 0);
    return { id: this.id, session, policy, seed, agent, learner, state, started, last, tags: ['mock', policy], note: 'a run of the mock', updates: this.length, recorded_episodes: this.episodes().length + (figures.episodes ?? 0), ...figures };
  }

  manifest(): Manifest {
    const { session, agent, learner, seed } = this.plan;
    const features = agent === 'features';
    return {
      program: 'policy_service',
      middleware: 'cyclonedds',
      session,
      agent,
      learner,
      seed,
      train: 'summer',
      evaluate: [...NAMES],
      first_frame: FIRST,
      frames: PLACES,
      max_steps: MAX_STEPS,
      tasks: 100,
      artefacts: { host: 'mock', folder: `/runs/${session}`, names: ['summary.json', 'checkpoints'] },
      parameters: { learner: { clip: 0.2, gamma: features ? 0.93 : 0.99, 'learning-rate': features ? 0.0015 : 0.003 }, trainer: { agents: features ? 32 : 8, sequence: 64 } },
    };
  }

  traversals(): RunTraversal[] {
    return this.all.map(({ name, hash, images }) => ({ environment: `env-${name}`, dataset: 'plain', traversal: name, condition: name, hash, frames: FRAMES, agents: 16, images }));
  }

  /** Some training episodes and, of a run that has ended, all evaluations; newest last. */
  episodes(): EpisodeDetail[] {
    if (this.recorded) return this.recorded;
    const { agent, spl: [, final], state } = this.plan;
    const random = new Random(900 + this.index);
    const list: EpisodeDetail[] = [];
    const add = (t: Traversal, [start, goal]: [number, number], skill: number, what: Pick<Episode, 'policy' | 'update' | 'shuffled' | 'evaluation' | 'task'>): void => {
      const positions = walk(start, goal, skill, random);
      const [steps, shortest, completed] = [positions.length - 1, Math.abs(goal - start), positions.at(-1) === goal];
      list.push({
        ...what,
        rowid: (this.index + 1) * 1_000_000 + list.length + 1,
        environment: `env-${t.name}`,
        incarnation: '1763740800123456',
        episode: list.length + 1,
        agent: list.length % 16,
        traversal: t.name,
        start,
        goal,
        steps,
        shortest,
        reward: (completed ? 1 : 0) - (steps - shortest) / MAX_STEPS,
        completed,
        spl: completed ? shortest / Math.max(shortest, steps) : 0,
        recorded: this.now - this.plan.ago + list.length * 0.05,
        positions: list.length % 97 === 96 ? null : positions,
        hash: t.hash,
      });
    };
    for (let i = 0; i < 120; ++i)
      add(this.all[0] as Traversal, task(random), 0.45 + (0.5 * i) / 120, { policy: agent, update: Math.floor((this.length * i) / 120), shuffled: false, evaluation: false, task: 0 });
    if (state === 'ended')
      this.all.forEach((t, ti) => {
        const tasks = Array.from({ length: 100 }, () => task(random));
        const loss = [0, 0.02, 0.05, 0.16][ti] ?? 0;
        const evaluations: [string, number, boolean, number][] = [
          ...[0.33, 0.46, 0.495].map((gain, i): [string, number, boolean, number] => [agent, Math.round(((i + 1) * this.length) / 3), false, 0.5 + final * gain - loss]),
          [agent, this.length, true, 0.53],
          ['sequence_filter', 0, false, 0.985 - loss / 2],
          ['shortest_path', 0, false, 1],
          ['blind', 0, false, 0.6],
        ];
        for (const [policy, update, shuffled, skill] of evaluations)
          tasks.forEach((one, number) => add(t, one, skill, { policy, update, shuffled, evaluation: true, task: number }));
      });
    return (this.recorded = list);
  }

  evaluations(): Evaluation[] {
    const groups = new Map<string, EpisodeDetail[]>();
    for (const one of this.episodes().filter(({ evaluation }) => evaluation)) {
      const key = `${one.policy} ${one.update} ${one.shuffled} ${one.traversal}`;
      groups.set(key, [...(groups.get(key) ?? []), one]);
    }
    return [...groups.values()].map((group) => {
      const { policy, update, shuffled, traversal } = group[0] as EpisodeDetail;
      const mean = (name: 'spl' | 'reward' | 'steps' | 'shortest'): number => average(group.map((one) => one[name]));
      const done = group.filter((one) => one.completed);
      const [spl, completed] = [mean('spl'), done.length / group.length];
      const half = 1.96 * Math.sqrt(average(group.map((one) => (one.spl - spl) ** 2)) / group.length);
      return {
        policy,
        update,
        shuffled,
        traversal,
        tasks: group.length,
        completed,
        failed: 1 - completed,
        spl,
        spl_low: spl - half,
        spl_high: spl + half,
        reward: mean('reward'),
        mean_steps: mean('steps'),
        shortest_mean: mean('shortest'),
        excess: done.length ? average(done.map((one) => one.steps / one.shortest)) : null,
      };
    });
  }
}

interface Agent {
  position: number;
  start: number;
  goal: number;
  steps: number;
  flags: number;
}

export interface LiveScene {
  environment: string;
  traversal: Traversal;
  mode: string;
  step: number;
  agents: Agent[];
}

export class World {
  readonly traversals = traversals();
  readonly runs: RunData[];
  readonly services: Service[];
  readonly events: ServiceEvent[];
  readonly scenes: LiveScene[];
  private readonly random = new Random(11);
  private readonly started = Date.now() / 1000;

  constructor(empty = false) {
    this.runs = empty ? [] : plans().map((plan, i) => new RunData(plan, i, this.traversals, this.started));
    const service = (id: string, kind: string, host: string, activity: string, rate: number, i: number): Service => ({
      id,
      service: kind,
      session: 'demo-2211',
      host,
      process: 4100 + 7 * i,
      middleware: i === 2 ? 'fastdds' : 'cyclonedds',
      incarnation: `17637408001234${50 + i}`,
      state: rate || i === 4 ? 'running' : 'waiting',
      activity,
      uptime: 90,
      rate,
      age: 0.3,
      processors: rate ? 0.4 + 0.1 * i : 0.01,
      memory: 60e6 + 7e6 * i,
      sent_bytes: 81e6 * (i + 1),
      received_bytes: 12e6 * (i + 1),
      received: 120_000 + 913 * i,
      repeated: 2 * i,
      resent: i,
      rejected: 0,
      foreign: 0,
      alarm: '',
      since: this.started - 90,
    });
    const activities = ['training, 16 agents', 'evaluating, 16 agents', 'evaluating, 16 agents', 'waiting for settings'];
    this.services = empty
      ? []
      : [
          ...NAMES.map((name, i) => service(`env-${name}`, 'env_service', i < 2 ? 'gpu-01' : 'gpu-02', activities[i] ?? '', i < 3 ? 1600 : 0, i)),
          service('encoder', 'encoder_service', 'gpu-02', 'hog, 3,000 frames stored', 0, 4),
          service('policy', 'policy_service', 'gpu-03', 'training place_filter with ppo, seed 4', 4800, 5),
        ];
    this.events = this.services.map((one) => ({ time: this.started - 60, session: one.session, service: one.id, kind: 'started', text: `${one.service} on ${one.host}` }));
    this.scenes = this.traversals.map((traversal, i) => ({
      environment: `env-${traversal.name}`,
      traversal,
      mode: i === 0 ? 'train' : 'evaluate',
      step: 12_000 + i,
      agents: Array.from({ length: 16 }, () => this.begin(this.random.below(PLACES) + FIRST)),
    }));
  }

  get running(): RunData | undefined {
    return this.runs.find((run) => run.plan.state === 'running');
  }

  private begin(position: number): Agent {
    let goal = position;
    while (goal === position) goal = FIRST + this.random.below(PLACES);
    return { position, start: position, goal, steps: 0, flags: 1 };
  }

  /** A tenth of a second passes. */
  tick(): void {
    for (const scene of this.scenes) {
      scene.step += 1;
      scene.agents = scene.agents.map((agent) => {
        if (agent.position === agent.goal || agent.steps >= MAX_STEPS) return this.begin(agent.position);
        const [, position = agent.position] = walk(agent.position, agent.goal, 0.9, this.random);
        return { ...agent, position, steps: agent.steps + 1, flags: 0 };
      });
    }
    for (const service of this.services.filter(({ state }) => state !== 'lost')) {
      service.received = (service.received ?? 0) + 160;
      service.uptime = (service.uptime ?? 0) + 0.1;
    }
  }

  /** Changes a service. Returns the event, which it records. */
  change(id: string, kind: EventKind, text: string, what: Partial<Service>): ServiceEvent {
    const service = this.services.find((one) => one.id === id);
    if (!service) throw new Error(`no service has the ID ${id}`);
    Object.assign(service, what);
    const event = { time: Date.now() / 1000, session: service.session, service: id, kind, text };
    this.events.unshift(event);
    return event;
  }
}

export const CONTROLS: { blind: ControlFigures; shortest_path: ControlFigures } = {
  blind: { spl: 0.68, reward: 0.57, steps: 78.7, completed: 0.87 },
  shortest_path: { spl: 1, reward: 1, steps: 43, completed: 1 },
};

export function recognition(): { results: Recognition[]; curves: RecognitionCurve[] } {
  const list = [
    ['hog', 'nearest', 0.749, 0.676],
    ['hog', 'csls+sequence', 0.998, 0.998],
    ['patchnorm', 'nearest', 0.115, 0.027],
    ['vlad', 'nearest', 0.413, 0.271],
  ] as const;
  const points = Array.from({ length: 60 }, (_, i) => i / 59);
  const same = { dimension: 3780, centring: 'own', query: 'winter' };
  const curves = list.map(([encoder, method, recall, auc]) => ({
    ...same,
    encoder,
    method,
    auc,
    recall: points.map((share) => recall * share),
    precision: points.map((share) => 1 - (1 - recall) * 0.9 * share ** 2),
  }));
  const interval = (value: number): [number, number] => [Math.max(0, value - 0.045), Math.min(1, value + 0.045)];
  const rows = list.map(([encoder, method, recall, auc]) => ({
    ...same,
    encoder,
    method,
    name: `${encoder}-1`,
    pca: false,
    whitening: 0,
    condition: 'winter',
    references: 358,
    queries: 358,
    tolerance: 2,
    recall_1: recall,
    recall_1_interval: interval(recall),
    recall_5: Math.min(1, recall + 0.1),
    recall_10: Math.min(1, recall + 0.14),
    auc,
    auc_interval: interval(auc),
    recall_at_full_precision: recall * 0.4,
    encode_seconds: 3.4,
    seconds: 4.1,
  }));
  const matrices = list.map(([encoder, method]) => `similarity-${encoder}-3780-own-winter-${method.replace('+', '-')}.png`);
  const result = { name: 'vpr-nordland', file: 'runs/vpr-nordland/results.json', program: 'citylearn_vpr', command: './run vpr --dataset plain --data nordland-64x32', dataset: 'plain', reference: 'summer', ground_truth: 'frame by frame', measure: 'cosine' };
  return { results: [{ ...result, rows, matrices }], curves };
}
