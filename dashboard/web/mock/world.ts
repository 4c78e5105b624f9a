// SPDX-License-Identifier: Apache-2.0
import type {
  ControlFigures,
  Episode,
  Evaluation,
  EventKind,
  Json,
  Manifest,
  Recognition,
  RecognitionCurve,
  RecognitionRow,
  Run,
  RunTraversal,
  Service,
  ServiceEvent,
  ServiceState,
  TraversalMap,
} from '../src/api/types';
import { Random } from './random';

// A cluster that trains: five runs and their past, services that come and go, agents on a route. Invented from a seed; the
// shapes are those of real runs.

export interface Traversal {
  name: string;
  hash: string;
  frames: number;
  images: boolean;
  map: TraversalMap;
}

const FRAMES = 1000;
const FIRST = 17;
const N = 128;
const MAX_STEPS = 128;

function traversals(): Traversal[] {
  // A line through hills: heading turns slowly, 22 m a frame.
  const random = new Random(5);
  const latitude: number[] = [];
  const longitude: number[] = [];
  const position: number[] = [];
  let [lat, lon, heading, turn, metres] = [67.28, 14.4, 0.9, 0, 0];
  for (let i = 0; i < FRAMES; ++i) {
    latitude.push(lat);
    longitude.push(lon);
    position.push(metres);
    turn = turn * 0.97 + random.normal() * 0.012;
    heading += turn;
    lat += (22 * Math.cos(heading)) / 111_200;
    lon += (22 * Math.sin(heading)) / (111_200 * Math.cos((lat * Math.PI) / 180));
    metres += 22;
  }
  const shaken = (values: number[], seed: number): number[] => {
    const noise = new Random(seed);
    return values.map((value) => value + noise.normal() * 2e-5);
  };
  const none = position.map(() => null);
  const make = (name: string, hash: string, images: boolean, map: Omit<TraversalMap, 'hash' | 'frames'>): Traversal => ({
    name,
    hash,
    frames: FRAMES,
    images,
    map: { hash, frames: FRAMES, ...map },
  });
  return [
    make('summer', '8c4635a1bbce08e9', true, { position, latitude, longitude }),
    make('fall', '51f0c3a2907de411', true, { position, latitude: shaken(latitude, 3), longitude: shaken(longitude, 4) }),
    make('winter', 'd07be4c19a35f862', true, { position, latitude: null, longitude: null }),
    make('night', '2b9917aa60cd3e5f', false, { position: none, latitude: null, longitude: null }),
  ];
}

export interface Rows {
  columns: Record<string, number[]>;
  length: number;
}

interface Plan {
  run: string;
  policy: string;
  seed: number;
  agent: string;
  learner: string;
  updates: number;
  stepsEach: number;
  rate: number;
  reward: [number, number];
  spl: [number, number];
  tau: number;
  state: Run['state'];
  ago: number;
  images: boolean;
}

/** A simulated walk: positions, one more than steps. */
interface Walk {
  positions: number[];
  completed: boolean;
}

function walk(start: number, goal: number, skill: number, random: Random): Walk {
  const positions = [start];
  let at = start;
  while (at !== goal && positions.length <= MAX_STEPS) {
    const towards = Math.sign(goal - at);
    const luck = random.next();
    const step = luck < skill ? towards : luck < skill + (1 - skill) * 0.7 ? -towards : 0;
    at = Math.min(Math.max(at + step, FIRST), FIRST + N - 1);
    positions.push(at);
  }
  return { positions, completed: at === goal };
}

function sweep(start: number, goal: number): Walk {
  const positions = [start];
  let direction = goal - FIRST < N / 2 ? -1 : 1;
  for (let at = start; at !== goal; positions.push(at)) {
    if (at + direction < FIRST || at + direction > FIRST + N - 1) direction = -direction;
    at += direction;
  }
  return { positions, completed: positions.length <= MAX_STEPS + 1 };
}

/** Reward of the paper: a step that brings the agent nearer than ever is free, each other costs 1 / max_steps. */
function rewardOf(one: Walk, goal: number): number {
  let best = Math.abs(goal - (one.positions[0] as number));
  let reward = one.completed ? 1 : 0;
  for (let i = 1; i < one.positions.length; ++i) {
    const before = Math.abs(goal - (one.positions[i - 1] as number));
    const now = Math.abs(goal - (one.positions[i] as number));
    if (now < before && before <= best) best = now;
    else reward -= 1 / MAX_STEPS;
  }
  return reward;
}

type Kept = Episode & { positions: number[] | null; hash: string };

export class RunData {
  readonly id: string;
  readonly rows: Rows;
  readonly random: Random;
  private kept: Kept[] | null = null;
  private noise = 0;

  constructor(
    readonly plan: Plan,
    readonly index: number,
    readonly all: Traversal[],
    readonly now: number,
  ) {
    this.id = `${plan.run}/${plan.policy}/${plan.seed}/${1_763_740_800_000_000 + index}`;
    this.random = new Random(100 + index);
    this.rows = { columns: {}, length: 0 };
    for (let i = 0; i < plan.updates; ++i) this.update();
  }

  /** One more update. */
  update(): void {
    const { plan, random } = this;
    const n = this.rows.length + 1;
    const steps = n * plan.stepsEach;
    const last = (name: string): number => this.rows.columns[name]?.[n - 2] ?? 0;
    const share = 1 - Math.exp(-steps / plan.tau);
    this.noise = 0.9 * this.noise + random.normal() * 0.012;
    const level = ([from, to]: [number, number]): number => Math.min(1, from + (to - from) * share + this.noise * (1.3 - share));
    const spl = Math.max(0, level(plan.spl));
    const length = 43 / Math.max(spl, 0.35);
    const row: Record<string, number> = {
      update: n,
      steps,
      episodes: last('episodes') + Math.max(0, Math.round(plan.stepsEach / length + random.normal())),
      lesson: plan.learner === 'vtrace' ? Math.min(6, Math.floor(n / (plan.updates / 7 || 1))) : 0,
      wall: last('wall') + plan.stepsEach / plan.rate,
      steps_per_second: plan.rate * (1 + 0.05 * random.normal()),
      reward: n === 1 ? NaN : level(plan.reward),
      spl: n === 1 ? NaN : spl,
      policy_loss: -0.002 * (1 - share) + 0.001 * random.normal(),
      value_loss: 0.03 * (1.1 - share) * (1 + 0.2 * random.normal()),
      entropy: 1.0986 - 0.78 * share + 0.02 * random.normal(),
      approx_kl: Math.abs(0.004 * (1.2 - share) * (1 + 0.4 * random.normal())),
      clip_fraction: Math.abs(0.06 * (1.1 - share) * (1 + 0.4 * random.normal())),
      gradient_norm: 4 + 20 * (1.05 - share) + random.normal(),
      learning_rate: 0.003 * Math.max(0.02, 1 - n / (plan.state === 'running' ? 4000 : plan.updates)),
      policy_lag: plan.learner === 'vtrace' ? 1.4 + 0.3 * random.normal() : 0,
    };
    for (const [name, value] of Object.entries(row)) (this.rows.columns[name] ??= []).push(value);
    this.rows.length = n;
  }

  last(name: string): number | null {
    const value = this.rows.columns[name]?.[this.rows.length - 1];
    return value === undefined || Number.isNaN(value) ? null : value;
  }

  summary(): Run {
    const { plan } = this;
    const started = this.now - plan.ago;
    return {
      id: this.id,
      run: plan.run,
      policy: plan.policy,
      seed: plan.seed,
      agent: plan.agent,
      learner: plan.learner,
      state: plan.state,
      started,
      last: plan.state === 'running' ? Date.now() / 1000 : started + (this.last('wall') ?? 0),
      updates: this.rows.length,
      steps: this.last('steps'),
      episodes: this.last('episodes'),
      recorded_episodes: this.episodes().length + (this.last('episodes') ?? 0),
      reward: this.last('reward'),
      spl: this.last('spl'),
      wall: this.last('wall'),
      steps_per_second: this.last('steps_per_second'),
    };
  }

  manifest(): Manifest {
    const { plan } = this;
    const learner: Record<string, Json> = {
      clip: 0.2,
      entropy: 0.02,
      gamma: plan.agent === 'features' ? 0.93 : 0.99,
      lambda: plan.agent === 'features' ? 0.8 : 0.95,
      'learning-rate': plan.agent === 'features' ? 0.0015 : 0.003,
      minibatch: plan.agent === 'features' ? 8 : 4,
    };
    return {
      program: 'policy_service 0.1.0 (6b56793)',
      middleware: 'cyclonedds',
      vendor: 'Eclipse Cyclone DDS over UDP',
      run: plan.run,
      mode: 'train',
      agent: plan.agent,
      learner: plan.learner,
      seed: plan.seed,
      train: 'summer',
      evaluate: ['summer', 'fall', 'winter', 'night'],
      first_frame: FIRST,
      frames: N,
      max_steps: MAX_STEPS,
      curriculum: plan.learner === 'vtrace',
      tasks: 100,
      parameters: { learner, trainer: { agents: plan.agent === 'features' ? 32 : 8, sequence: 64 } },
      traversals: Object.fromEntries(this.all.map((t) => [t.name, { hash: t.hash, frames: t.frames, encoder: plan.images ? 'hog' : '' }])),
    };
  }

  traversals(): RunTraversal[] {
    return this.all.map((t) => ({
      environment: `env-${t.name}`,
      dataset: 'plain',
      traversal: t.name,
      condition: t.name,
      hash: t.hash,
      frames: t.frames,
      agents: 16,
      images: t.images && this.plan.images,
    }));
  }

  /** Evaluations and the last training episodes, newest last. */
  episodes(): Kept[] {
    if (this.kept) return this.kept;
    const random = new Random(900 + this.index);
    const kept: Kept[] = [];
    const final = this.plan.spl[1];
    const end = this.rows.length;
    const add = (t: Traversal, policy: string, update: number, shuffled: boolean, evaluation: boolean, task: number, start: number, goal: number, one: Walk): void => {
      const steps = one.positions.length - 1;
      const shortest = Math.abs(goal - start);
      kept.push({
        rowid: (this.index + 1) * 1_000_000 + kept.length + 1,
        environment: `env-${t.name}`,
        incarnation: '1763740800123456',
        episode: kept.length + 1,
        agent: kept.length % 16,
        evaluation,
        task,
        traversal: t.name,
        policy,
        update,
        shuffled,
        start,
        goal,
        steps,
        shortest,
        reward: rewardOf(one, goal),
        completed: one.completed,
        spl: one.completed ? shortest / Math.max(shortest, steps) : 0,
        recorded: this.now - this.plan.ago + kept.length * 0.05,
        positions: kept.length % 97 === 96 ? null : one.positions,
        hash: t.hash,
      });
    };
    const summer = this.all[0] as Traversal;
    for (let i = 0; i < 120; ++i) {
      const [start, goal] = pair(random);
      add(summer, this.plan.agent, Math.floor((end * i) / 120), false, false, 0, start, goal, walk(start, goal, 0.45 + (0.5 * i) / 120, random));
    }
    if (this.plan.state === 'ended') {
      this.all.forEach((t, ti) => {
        const tasks = Array.from({ length: 100 }, () => pair(random));
        const loss = [0, 0.02, 0.05, 0.16][ti] ?? 0;
        const policies: [string, number, boolean, number][] = [
          [this.plan.agent, Math.round(end / 3), false, 0.5 + final * 0.33 - loss],
          [this.plan.agent, Math.round((2 * end) / 3), false, 0.5 + final * 0.46 - loss],
          [this.plan.agent, end, false, 0.5 + final * 0.495 - loss],
          [this.plan.agent, end, true, 0.53],
          ['sequence_filter', 0, false, 0.985 - loss / 2],
          ['shortest_path', 0, false, 1.01],
        ];
        for (const [policy, update, shuffled, skill] of policies)
          tasks.forEach(([start, goal], task) => add(t, policy, update, shuffled, true, task, start, goal, walk(start, goal, skill, random)));
        tasks.forEach(([start, goal], task) => add(t, 'blind', 0, false, true, task, start, goal, sweep(start, goal)));
      });
    }
    this.kept = kept;
    return kept;
  }

  evaluations(): Evaluation[] {
    const groups = new Map<string, Kept[]>();
    for (const one of this.episodes())
      if (one.evaluation) {
        const key = `${one.policy} ${one.update} ${one.shuffled} ${one.traversal}`;
        groups.set(key, [...(groups.get(key) ?? []), one]);
      }
    return [...groups.values()].map((group) => {
      const first = group[0] as Kept;
      const done = group.filter((one) => one.completed);
      const random = new Random(1);
      const means = Array.from({ length: 200 }, () => average(group.map(() => (group[random.below(group.length)] as Kept).spl))).sort(
        (a, b) => a - b,
      );
      return {
        policy: first.policy,
        update: first.update,
        shuffled: first.shuffled,
        traversal: first.traversal,
        tasks: group.length,
        completed: done.length / group.length,
        failed: 1 - done.length / group.length,
        spl: average(group.map((one) => one.spl)),
        spl_low: means[5] as number,
        spl_high: means[194] as number,
        reward: average(group.map((one) => one.reward)),
        mean_steps: average(group.map((one) => one.steps)),
        shortest_mean: average(group.map((one) => one.shortest)),
        excess: done.length ? average(done.map((one) => one.steps / one.shortest)) : null,
      };
    });
  }
}

function pair(random: Random): [number, number] {
  const start = FIRST + random.below(N);
  const goal = FIRST + random.below(N - 1);
  return [start, goal >= start ? goal + 1 : goal];
}

function average(values: readonly number[]): number {
  return values.reduce((a, b) => a + b, 0) / values.length;
}

interface Agent {
  start: number;
  goal: number;
  position: number;
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
  readonly events: ServiceEvent[] = [];
  readonly scenes: LiveScene[];
  readonly started = Date.now() / 1000;
  private readonly random = new Random(11);
  private heard = new Map<string, number>();

  constructor(empty = false) {
    const plans: Plan[] = [];
    const base = { policy: 'policy', images: true, state: 'ended' as Run['state'] };
    const filter = { ...base, run: 'demo-2211', agent: 'place_filter', learner: 'ppo', stepsEach: 512, rate: 4800, tau: 9000 };
    for (let seed = 1; seed <= 4; ++seed)
      plans.push({
        ...filter,
        seed,
        updates: seed === 4 ? 60 : 90,
        reward: [-0.55, 0.985 + 0.003 * seed],
        spl: [0.05, 0.97 + 0.006 * seed],
        tau: 7000 + 1500 * seed,
        state: seed === 4 ? 'running' : 'ended',
        ago: 30 + 20 * (4 - seed),
      });
    plans.push({ ...base, run: 'relabel-1907', agent: 'place_filter', learner: 'relabel', seed: 1, updates: 200, stepsEach: 256, rate: 9000, reward: [-0.4, 0.99], spl: [0.08, 0.985], tau: 5000, ago: 5400 });
    for (let seed = 1; seed <= 5; ++seed)
      plans.push({ ...base, run: 'features-1830', agent: 'features', learner: 'ppo', seed, updates: 120, stepsEach: 2048, rate: 8800, reward: [-0.7, 0.93 + 0.008 * seed], spl: [0.02, 0.88 + 0.018 * seed], tau: 45_000 + 9000 * (seed % 3), ago: 9000 - 60 * seed });
    plans.push({ ...base, run: 'pixels-0412', policy: 'learner', agent: 'raw_images', learner: 'vtrace', seed: 1, updates: 12_000, stepsEach: 512, rate: 3100, reward: [-0.8, 0.9], spl: [0.01, 0.87], tau: 1_500_000, state: 'lost', ago: 90_000 });
    this.runs = empty ? [] : plans.map((plan, i) => new RunData(plan, i, this.traversals, this.started));
    this.services = empty ? [] : this.makeServices();
    for (const service of this.services) this.heard.set(service.id, this.started);
    this.scenes = this.traversals.slice(0, 4).map((traversal, i) => ({
      environment: `env-${traversal.name}`,
      traversal,
      mode: i === 0 ? 'train' : 'evaluate',
      step: 12_000 + i,
      agents: Array.from({ length: 16 }, () => this.episode(this.random.below(N) + FIRST)),
    }));
    if (!empty)
      for (const service of [...this.services].reverse())
        this.events.unshift({ time: this.started - 60, run: service.run, service: service.id, kind: 'started', text: `${service.service} on ${service.host}` });
  }

  get running(): RunData | undefined {
    return this.runs.find((run) => run.plan.state === 'running');
  }

  private makeServices(): Service[] {
    const hosts: Record<string, string> = { summer: 'gpu-01', fall: 'gpu-01', winter: 'gpu-02', night: 'gpu-02' };
    const make = (id: string, service: string, host: string, state: ServiceState, activity: string, rate: number, i: number): Service => ({
      id,
      service,
      run: 'demo-2211',
      host,
      process: 4100 + 7 * i,
      middleware: i === 2 ? 'fastdds' : 'cyclonedds',
      incarnation: `17637408001234${50 + i}`,
      state,
      activity,
      uptime: 90,
      rate,
      age: 0.3,
      received: 120_000 + 913 * i,
      repeated: 2 * i,
      resent: i,
      rejected: 0,
      foreign: 0,
      alarm: '',
      since: this.started - 90,
    });
    const list = this.traversals.map((t, i) =>
      make(`env-${t.name}`, 'env_service', hosts[t.name] ?? 'gpu-01', i === 3 ? 'waiting' : 'running', i === 3 ? 'waiting for settings' : i === 0 ? 'training, 16 agents' : 'evaluating, 16 agents', i === 3 ? 0 : 1600, i),
    );
    list.push(make('encoder', 'encoder_service', 'gpu-02', 'running', 'hog, 3,000 frames stored', 0, 4));
    list.push(make('policy', 'policy_service', 'gpu-03', 'running', 'training place_filter with ppo, seed 4', 4800, 5));
    return list;
  }

  private episode(position: number): Agent {
    let goal = position;
    while (goal === position) goal = FIRST + this.random.below(N);
    return { start: position, goal, position, steps: 0, flags: 1 };
  }

  /** A tenth of a second passes. */
  tick(): void {
    for (const scene of this.scenes) {
      scene.step += 1;
      scene.agents = scene.agents.map((agent) => {
        if (agent.position === agent.goal || agent.steps >= MAX_STEPS) return this.episode(agent.position);
        const skill = scene.mode === 'train' ? 0.86 : 0.93;
        const towards = Math.sign(agent.goal - agent.position);
        const step = this.random.next() < skill ? towards : -towards;
        const position = Math.min(Math.max(agent.position + step, FIRST), FIRST + N - 1);
        return { ...agent, position, steps: agent.steps + 1, flags: 0 };
      });
    }
    const now = Date.now() / 1000;
    for (const service of this.services) {
      if (service.state === 'lost' || service.state === 'stopped') continue;
      const heard = this.heard.get(service.id) ?? now;
      if (now - heard >= 1) this.heard.set(service.id, now);
      if (service.rate) service.rate = service.rate * 0.95 + 0.05 * (service.service === 'policy_service' ? 4800 : 1600) * (1 + 0.3 * this.random.normal());
      service.received = (service.received ?? 0) + 160;
      service.uptime = now - (service.since ?? now);
    }
  }

  serviceList(): Service[] {
    const now = Date.now() / 1000;
    return this.services.map((service) => ({ ...service, age: now - (this.heard.get(service.id) ?? now) }));
  }

  /** A service is killed, as the server would tell it. */
  lose(id: string): ServiceEvent | null {
    return this.turn(id, 'lost', 'lost', 'no heartbeat for 2 s');
  }

  bring(id: string): ServiceEvent | null {
    return this.turn(id, 'running', 'back', 'heard again');
  }

  /** The service says that something is wrong, or with an empty text that it is no more. */
  alarm(id: string, text: string): ServiceEvent | null {
    const service = this.services.find((one) => one.id === id);
    if (!service) return null;
    service.alarm = text;
    const event: ServiceEvent = { time: Date.now() / 1000, run: service.run, service: id, kind: 'alarm', text: text || 'is well again' };
    this.events.unshift(event);
    return event;
  }

  private turn(id: string, state: ServiceState, kind: EventKind, text: string): ServiceEvent | null {
    const service = this.services.find((one) => one.id === id);
    if (!service || service.state === state) return null;
    service.state = state;
    service.since = Date.now() / 1000;
    if (state === 'lost') service.rate = 0;
    else {
      service.rate = 1600;
      this.heard.set(id, service.since);
    }
    const event = { time: Date.now() / 1000, run: service.run, service: id, kind, text };
    this.events.unshift(event);
    return event;
  }
}

/** Over all tasks of a route of n places. */
export function controls(n: number, maxSteps: number): { blind: ControlFigures; shortest_path: ControlFigures } {
  const sum = { spl: 0, reward: 0, steps: 0, completed: 0, shortest: 0, count: 0 };
  for (let start = 0; start < n; ++start)
    for (let goal = 0; goal < n; ++goal) {
      if (goal === start) continue;
      const down = goal < n / 2;
      const wrong = down ? (goal > start ? start : 0) : goal < start ? n - 1 - start : 0;
      const shortest = Math.abs(goal - start);
      const steps = 2 * wrong + shortest;
      const completed = steps <= maxSteps;
      sum.count += 1;
      sum.steps += Math.min(steps, maxSteps);
      sum.shortest += Math.min(shortest, maxSteps);
      sum.completed += completed ? 1 : 0;
      sum.spl += completed ? shortest / steps : 0;
      sum.reward += (completed ? 1 : 0) - Math.min(2 * wrong, maxSteps) / maxSteps;
    }
  return {
    blind: { spl: sum.spl / sum.count, reward: sum.reward / sum.count, steps: sum.steps / sum.count, completed: sum.completed / sum.count },
    shortest_path: { spl: 1, reward: 1, steps: sum.shortest / sum.count, completed: 1 },
  };
}

export function recognition(): { results: Recognition[]; curves: RecognitionCurve[] } {
  const rows: RecognitionRow[] = [];
  const curves: RecognitionCurve[] = [];
  const list: [string, string, number, number, number][] = [
    ['hog', 'nearest', 0, 0.749, 0.676],
    ['hog', 'csls', 0, 0.802, 0.784],
    ['hog', 'csls+sequence', 0, 0.998, 0.998],
    ['hog', 'nearest', 64, 0.709, 0.657],
    ['patchnorm', 'nearest', 0, 0.115, 0.027],
    ['vlad', 'nearest', 0, 0.413, 0.271],
  ];
  for (const [encoder, method, dimension, recall, auc] of list) {
    const points = 60;
    const fall = recall / Math.max(auc, 0.01) - 1;
    curves.push({
      encoder,
      dimension: dimension || 3780,
      centring: 'own',
      method,
      query: 'winter',
      auc,
      recall: Array.from({ length: points }, (_, i) => (recall * i) / (points - 1)),
      precision: Array.from({ length: points }, (_, i) => Math.max(0.02, 1 - (1 - recall) * 0.9 * (i / (points - 1)) ** (1 / (fall + 0.4)))),
    });
    rows.push({
      encoder,
      name: `${encoder}-1`,
      dimension: dimension || 3780,
      pca: dimension > 0,
      centring: 'own',
      whitening: 0,
      method,
      query: 'winter',
      condition: 'winter',
      references: 358,
      queries: 358,
      tolerance: 2,
      recall_1: recall,
      recall_1_interval: [Math.max(0, recall - 0.045), Math.min(1, recall + 0.045)],
      recall_5: Math.min(1, recall + 0.1),
      recall_10: Math.min(1, recall + 0.14),
      auc,
      auc_interval: [Math.max(0, auc - 0.06), Math.min(1, auc + 0.06)],
      recall_at_full_precision: recall * 0.4,
      encode_seconds: 3.4,
      seconds: 4.1,
    });
  }
  return {
    results: [
      {
        name: 'vpr-nordland',
        file: 'runs/vpr-nordland/results.json',
        program: 'citylearn_vpr 0.1.0',
        command: './run vpr --dataset plain --data nordland-64x32 --reference summer --query winter --encoder hog,patchnorm,vlad',
        dataset: 'plain',
        reference: 'summer',
        ground_truth: 'frame by frame',
        measure: 'cosine',
        rows,
        matrices: rows.map((row) => `similarity-${row.encoder}-${row.dimension}-own-winter-${row.method.replace('+', '-')}.png`),
      },
    ],
    curves,
  };
}
