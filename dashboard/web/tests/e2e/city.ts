// SPDX-License-Identifier: Apache-2.0
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { chromium } from 'playwright-core';
import type { TestProject } from 'vitest/node';
import type { Run } from '../../src/api/types';
import { ARGS, executable } from '../chromium';
import { api, eventually, PAGE, Program, startDashboard, type Options } from './programs';

/** What all specs share: a browser, and a dashboard with trainings that have ended and one that goes on. */
export interface City {
  browser: string;
  url: string;
  page: string;
  /** Options of a node that takes part. */
  wire: Options;
  /** ID of the process of the encoder_service, which the training does not need any more. */
  encoder: number;
}

declare module 'vitest' {
  interface ProvidedContext {
    city: City;
  }
}

const DEADLINE = 120_000; // milliseconds; a sanitizer makes programs slow
const FRAMES = '0:24';

/** Lets a program run a tenth of the time, so that the browser has the processors. Returns how that ends. */
function slowed(program: Program): () => void {
  const signal = (name: NodeJS.Signals): void => {
    if (!program.over) process.kill(program.pid, name);
  };
  let pause: ReturnType<typeof setTimeout> | undefined;
  const timer = setInterval(() => {
    signal('SIGCONT');
    pause = setTimeout(() => signal('SIGSTOP'), 10);
  }, 100);
  return () => {
    clearInterval(timer);
    clearTimeout(pause); // a program that stands does not end
    signal('SIGCONT');
  };
}

/** Starts it all: a drawn city in summer and winter, its services, trainings with evaluations. */
export async function startCity(): Promise<{ city: City; stop: () => Promise<void> }> {
  const folder = mkdtempSync(join(tmpdir(), 'citylearn-page-'));
  const wire: Options = { session: 'city', domain: Number(process.env.CITYLEARN_DOMAIN ?? 109), middleware: 'cyclonedds', interface: 'lo' };
  const programs: Program[] = [];
  const start = (service: string, name: string, options: Options): Program => {
    const program = Program.start(`${service}/${service.split('/').at(-1)}`, { ...options }, { folder, name, nice: service !== 'dashboard' });
    programs.push(program);
    return program;
  };
  let hurry = (): void => undefined;
  const stop = async (): Promise<void> => {
    hurry();
    await Promise.all(programs.map((program) => program.kill()));
    rmSync(folder, { recursive: true });
  };
  try {
    const browser = chromium.launchServer({ executablePath: executable(), args: ARGS });
    const dashboard = await startDashboard(wire, folder);
    programs.push(dashboard.program);
    const source = { dataset: 'synthetic', 'synthetic-frames': 200, frames: FRAMES };
    const env = { ...wire, ...source, agents: 4, recorders: 'dashboard' };
    start('env_service', 'env-summer', { ...env, id: 'env-summer', traversal: 'summer' });
    start('env_service', 'env-winter', { ...env, id: 'env-winter', traversal: 'winter', 'align-to': 'summer' });
    const encoder = start('encoder_service', 'encoder', { id: 'encoder', ...wire, reference: 'summer', encoder: 'patchnorm', store: join(folder, 'features') });
    const policy = { ...wire, train: 'summer', frames: FRAMES, wait: 60 };
    const evaluated = { ...policy, evaluate: 'summer,winter', tasks: 60, controls: 'all' };
    await start('policy_service', 'policy', { ...evaluated, seeds: '1..3', steps: 6000, 'evaluate-every': 5, output: join(folder, 'policy') }).ended();
    await start('policy_service', 'spare', { ...evaluated, id: 'spare', steps: 1000, 'ppo-gamma': 0.95, output: join(folder, 'spare') }).ended();
    const live = start('policy_service', 'live', { ...policy, id: 'live', evaluate: 'summer', threads: 1, steps: 1_000_000_000, output: join(folder, 'live') });
    const there = ({ runs }: { runs: Run[] }): boolean => runs.filter(({ state }) => state === 'ended').length === 4 && runs.some(({ state, updates }) => state === 'running' && (updates ?? 0) > 3);
    await eventually(() => api<{ runs: Run[] }>(dashboard.url, 'runs'), there, DEADLINE);
    hurry = slowed(live);
    const server = await browser;
    return {
      city: { browser: server.wsEndpoint(), url: dashboard.url, page: PAGE, wire, encoder: encoder.pid },
      stop: async () => {
        await server.close();
        await stop();
      },
    };
  } catch (error) {
    await stop();
    throw error;
  }
}

export default async function setup(project: TestProject): Promise<() => Promise<void>> {
  const { city, stop } = await startCity();
  project.provide('city', city);
  return stop;
}
