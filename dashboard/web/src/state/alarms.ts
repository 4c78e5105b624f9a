// SPDX-License-Identifier: Apache-2.0
import { computed, effect, signal } from '@preact/signals';
import type { AlarmsAnswer } from '../api/alarms';
import { getJson, unauthorised } from '../api/client';
import { jsonPayload } from '../api/frame';
import { live } from '../api/live';
import { raisedAlarms } from '../maths/alarms';
import { failure, valueOf, type Resource } from './resource';
import { services } from './shared';

/** Alarms of runs, and the rules by which they are raised. */
export const alarms = signal<Resource<AlarmsAnswer>>({ state: 'loading' });

/** The alarms that last, of services and of runs. */
export const raised = computed(() => raisedAlarms(valueOf(services.value)?.services ?? [], valueOf(alarms.value)?.alarms ?? []));

export function loadAlarms(): void {
  getJson<AlarmsAnswer>('api/alarms')
    .then((value) => (alarms.value = { state: 'ready', value }))
    .catch((error: unknown) => {
      const failed = failure(error);
      if (failed.status !== 0 || alarms.value.state !== 'ready') alarms.value = failed;
    });
}

export function startAlarms(): void {
  live.watch('alarms', (frame) => {
    alarms.value = { state: 'ready', value: jsonPayload<AlarmsAnswer>(frame) };
  });
  live.onBack(loadAlarms);
  effect(() => {
    if (!unauthorised.value) loadAlarms();
  });
}
