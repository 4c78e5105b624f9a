// SPDX-License-Identifier: Apache-2.0
import type { Belief, Scene, SceneAgent, SceneHeader } from './types';

/** A parsed binary frame of the WebSocket. */
export interface Frame {
  topic: string;
  /** Number of messages that this client has lost so far. */
  dropped: number;
  header: Record<string, unknown>;
  payload: Uint8Array;
}

/** Thrown for a malformed frame. The connection is then closed. */
export class FrameError extends Error {}

/**
 * Parses a frame: uint32 n (little-endian), n bytes of JSON, the payload. 4 + n is a multiple of 8, so that numbers of
 * eight bytes are aligned.
 */
export function parseFrame(data: ArrayBuffer): Frame {
  if (data.byteLength < 4) throw new FrameError(`a frame of ${data.byteLength} bytes has no header`);
  const length = new DataView(data).getUint32(0, true);
  const start = 4 + length;
  if (start > data.byteLength) throw new FrameError(`header of ${length} bytes in a frame of ${data.byteLength}`);
  if (start % 8 !== 0) throw new FrameError(`header of ${length} bytes: the payload is not aligned to 8 bytes`);
  let header: unknown;
  try {
    header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  } catch {
    throw new FrameError('the header is not JSON');
  }
  if (typeof header !== 'object' || header === null || !('topic' in header) || typeof header.topic !== 'string')
    throw new FrameError('the header names no topic');
  const fields = header as Record<string, unknown>;
  return {
    topic: header.topic,
    dropped: numberOf(fields.dropped),
    header: fields,
    payload: new Uint8Array(data, start),
  };
}

export function jsonPayload<T>(frame: Frame): T {
  return JSON.parse(new TextDecoder().decode(frame.payload)) as T;
}

/** Returns the rows of a `training:` frame as columns: name -> one number per row. */
export function trainingColumns(frame: Frame): Map<string, Float64Array> {
  const names = frame.header.columns;
  const rows = numberOf(frame.header.rows);
  if (!Array.isArray(names)) throw new FrameError('training: the header has no columns');
  if (frame.payload.byteLength !== rows * names.length * 8)
    throw new FrameError(`training: ${frame.payload.byteLength} bytes are not ${rows} x ${names.length} numbers`);
  const values = new Float64Array(frame.payload.buffer, frame.payload.byteOffset, rows * names.length);
  const columns = new Map<string, Float64Array>();
  names.forEach((name: unknown, column) => {
    const all = new Float64Array(rows);
    for (let row = 0; row < rows; ++row) all[row] = values[row * names.length + column] ?? NaN;
    columns.set(String(name), all);
  });
  return columns;
}

/** Parses a `scene:` frame: 6 x m uint32, m numbers for each field, then beliefs (docs/reference/dashboard-api.md). */
export function sceneOf(frame: Frame): Scene {
  const header = frame.header as unknown as SceneHeader;
  const m = numberOf(header.agents);
  const k = numberOf(header.likely);
  const count = (6 + (k > 0 ? 2 * k + 2 : 0)) * m;
  if (frame.payload.byteLength !== 4 * count) throw new FrameError(`scene: ${frame.payload.byteLength} bytes for ${m} agents`);
  const values = new Uint32Array(frame.payload.buffer, frame.payload.byteOffset, count);
  const shares = new Float32Array(frame.payload.buffer, frame.payload.byteOffset, count);
  const share = (number: number): number => shares[(6 + k) * m + number] ?? 0;
  const belief = (agent: number): Belief => ({
    places: Array.from({ length: k }, (_, i) => ({ frame: values[6 * m + k * agent + i] ?? 0, probability: share(k * agent + i) })),
    entropy: share(k * m + agent),
    lost: share((k + 1) * m + agent),
  });
  const at = (field: number, agent: number): number => values[field * m + agent] ?? 0;
  const list: SceneAgent[] = [];
  for (let i = 0; i < m; ++i)
    list.push({
      frame: at(0, i), position: at(1, i), start: at(2, i), goal: at(3, i), steps: at(4, i), flags: at(5, i),
      ...(k > 0 && at(4, i) > 0 ? { belief: belief(i) } : {}), // at an episode's start it is of the one before
    });
  return { ...header, list };
}

function numberOf(value: unknown): number {
  return typeof value === 'number' ? value : 0;
}
