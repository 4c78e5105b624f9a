// SPDX-License-Identifier: Apache-2.0
import { computed, effect, signal } from '@preact/signals';
import { getJson, unauthorised } from '../api/client';
import { jsonPayload } from '../api/frame';
import { live } from '../api/live';
import type { About, Run, ServiceEvent, Services } from '../api/types';
import { failure, valueOf, type Resource } from './resource';
import { heedRuns } from './training';

// What every page needs: services, runs and events, live from the start.

export interface SeenServices extends Services {
  /** When it arrived, milliseconds since 1970, by this machine's clock. */
  seen: number;
}

export const about = signal<Resource<About>>({ state: 'loading' });
export const services = signal<Resource<SeenServices>>({ state: 'loading' });
export const runs = signal<Resource<Run[]>>({ state: 'loading' });
export const events = signal<Resource<ServiceEvent[]>>({ state: 'loading' });
/** The time, milliseconds since 1970, updated once a second. */
export const now = signal(Date.now());

const known = computed(() => valueOf(services.value)?.services ?? []);
export const lostServices = computed(() => known.value.filter(({ state }) => state === 'lost' || state === 'failed').length);
export const alarmedServices = computed(() => known.value.filter((service) => service.alarm).length);

const MAX_EVENTS = 500;

async function load<T, U>(path: string, target: { value: Resource<U> }, turn: (answer: T) => U): Promise<void> {
  try {
    target.value = { state: 'ready', value: turn(await getJson<T>(path)) };
  } catch (error) {
    const failed = failure(error);
    if (failed.status !== 0 || target.value.state !== 'ready') target.value = failed;
  }
}

const seen = (all: Services): SeenServices => ({ ...all, seen: Date.now() });

export function reload(): void {
  void load('api/about', about, (answer: About) => answer);
  void load('api/services', services, seen);
  void load('api/runs', runs, (answer: { runs: Run[] }) => answer.runs);
  void load('api/events?limit=200', events, (answer: { events: ServiceEvent[] }) => answer.events);
}

export function start(): void {
  live.watch('services', (frame) => {
    services.value = { state: 'ready', value: seen(jsonPayload<Services>(frame)) };
  });
  live.watch('runs', (frame) => {
    runs.value = { state: 'ready', value: jsonPayload<{ runs: Run[] }>(frame).runs };
  });
  live.watch('events', (frame) => {
    events.value = { state: 'ready', value: [jsonPayload<ServiceEvent>(frame), ...(valueOf(events.value) ?? [])].slice(0, MAX_EVENTS) };
  });
  effect(() => heedRuns(valueOf(runs.value) ?? []));
  live.onBack(reload);
  setInterval(() => (now.value = Date.now()), 1000);
  // When the page or the network is back, it reconnects at once instead of at the end of the back-off.
  window.addEventListener('online', () => live.retry());
  document.addEventListener('visibilitychange', () => {
    if (!document.hidden) live.retry();
  });
  let refused = true; // so that the first run of the effect loads
  effect(() => {
    if (refused && !unauthorised.value) {
      reload();
      live.retry();
    }
    refused = unauthorised.value;
  });
  live.start();
}
