// SPDX-License-Identifier: Apache-2.0
import { computed, signal } from '@preact/signals';
import { getJson, patchJson } from '../api/client';
import { jsonPayload } from '../api/frame';
import { live } from '../api/live';
import type { Playback, PlaybackAnswer, PlaybackChange } from '../api/types';
import { failure } from './resource';

/** How the open recording is played; null while none is. */
export const playback = signal<Playback | null>(null);
/** Where updates and episodes are in it; null while they are not known. */
export const marks = signal<PlaybackAnswer['marks']>(null);
/** The first and the last moment that it has of each run; null while they are not known. */
export const spans = signal<PlaybackAnswer['spans']>(null);
/** Whether it is played on now. */
export const playing = computed(() => playback.value !== null && !playback.value.paused && !playback.value.ended);
/** What the server refused last. */
export const playbackError = signal('');

const PATH = 'api/playback';

/** Follows the open recording, if there is one. Calls `reset` when an earlier position is shown: what was fetched is of later. */
export function startPlayback(reset: () => void): void {
  live.watch('playback', (frame) => take(jsonPayload<Playback>(frame), reset));
  live.onBack(() => {
    playback.value = marks.value = spans.value = null; // another dashboard, perhaps
  });
}

function take(news: Playback, reset: () => void): void {
  const before = playback.value;
  playback.value = news;
  if (before && before.generation !== news.generation) reset();
  if (news.length !== null && before?.length == null)
    getJson<PlaybackAnswer>(PATH)
      .then((answer) => {
        marks.value = answer.marks;
        spans.value = answer.spans;
      })
      .catch(() => {
        spans.value = {}; // the bar and the cursor are there without them
      });
}

export function changePlayback(change: PlaybackChange): Promise<void> {
  const before = playback.value;
  return patchJson<PlaybackAnswer>(PATH, change)
    .then((answer) => {
      playbackError.value = '';
      // The topic says it too, and alone says the next generation.
      if (playback.value && before?.generation === answer.generation) playback.value = answer;
    })
    .catch((cause: unknown) => {
      playbackError.value = failure(cause).error;
    });
}

/** Pauses, or goes on; at the end it begins again. */
export function togglePlayback(): void {
  const now = playback.value;
  if (now) void changePlayback(now.ended ? { position: 0, paused: false } : { paused: !now.paused });
}

export function seekPlayback(position: number): void {
  const now = playback.value;
  if (now) void changePlayback({ position: Math.min(Math.max(position, 0), now.length ?? Infinity) });
}
