// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { FrameError, jsonPayload, parseFrame, sceneOf, trainingColumns } from '../../src/api/frame';
import { frameOf } from '../frame';

const frame = (...given: Parameters<typeof frameOf>): ArrayBuffer => new Uint8Array(frameOf(...given)).buffer;
const bytesOf = (values: Float64Array | Uint32Array): Uint8Array => new Uint8Array(values.buffer);

describe('parseFrame', () => {
  it('takes header and payload apart', () => {
    const got = parseFrame(frame({ topic: 'services', sequence: 7, dropped: 2 }, new TextEncoder().encode('{"now":1}')));
    expect(got.topic).toBe('services');
    expect(got.dropped).toBe(2);
    expect(jsonPayload(got)).toEqual({ now: 1 });
  });
  it.each([
    ['no header', new ArrayBuffer(3)],
    ['a header longer than the frame', Uint8Array.from([255, 0, 0, 0, 32, 32, 32, 32]).buffer],
    ['a payload that is not aligned', frame({ topic: 'a' }, new Uint8Array(8), 1)],
    ['a header that is not JSON', frame('{{{{', new Uint8Array(0))],
    ['a header without topic', frame({ sequence: 1 }, new Uint8Array(0))],
  ])('refuses %s', (_, data) => expect(() => parseFrame(data)).toThrow(FrameError));
});

describe('trainingColumns', () => {
  it('turns rows into columns', () => {
    const data = frame({ topic: 'training:a', columns: ['update', 'reward'], rows: 2 }, bytesOf(Float64Array.of(1, 0.5, 2, NaN)));
    const columns = trainingColumns(parseFrame(data));
    expect([...(columns.get('update') ?? [])]).toEqual([1, 2]);
    expect([...(columns.get('reward') ?? [])]).toEqual([0.5, NaN]);
  });
  it('refuses a payload of another size', () => {
    const data = frame({ topic: 'training:a', columns: ['update'], rows: 2 }, bytesOf(Float64Array.of(1)));
    expect(() => trainingColumns(parseFrame(data))).toThrow(FrameError);
  });
});

describe('sceneOf', () => {
  it('has a sequence of m numbers for each field', () => {
    const header = { topic: 'scene:a@b', traversal: 'summer', hash: '0', first_frame: 0, frames: 8, step: 3, mode: 'train', policy: 'p', agents: 2 };
    const scene = sceneOf(parseFrame(frame(header, bytesOf(Uint32Array.of(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 0, 1)))));
    expect(scene.traversal).toBe('summer');
    expect(scene.list).toEqual([
      { frame: 1, position: 3, start: 5, goal: 7, steps: 9, flags: 0 },
      { frame: 2, position: 4, start: 6, goal: 8, steps: 10, flags: 1 },
    ]);
  });
  it('has what agents on their way believe', () => {
    const header = { topic: 'scene:a@b', agents: 2, likely: 2 };
    const numbers = Uint32Array.of(1, 2, 3, 4, 5, 6, 7, 8, 0, 10, 0, 1, 41, 42, 7, 6);
    const shares = new Uint32Array(Float32Array.of(0.5, 0.25, 0.75, 0.125, 2, 1.5, 0.25, 0.0625).buffer);
    const scene = sceneOf(parseFrame(frame(header, bytesOf(Uint32Array.of(...numbers, ...shares)))));
    expect(scene.list[0]?.belief).toBeUndefined();
    expect(scene.list[1]?.belief).toEqual({
      places: [{ frame: 7, probability: 0.75 }, { frame: 6, probability: 0.125 }], entropy: 1.5, lost: 0.0625,
    });
  });
  it('refuses a payload of another size', () => {
    const header = { topic: 'scene:a@b', agents: 2 };
    expect(() => sceneOf(parseFrame(frame(header, bytesOf(Uint32Array.of(1)))))).toThrow(FrameError);
  });
});
