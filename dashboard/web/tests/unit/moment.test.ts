// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Evaluation } from '../../src/api/types';
import { evaluationUntil, momentAt, momentName, pointText } from '../../src/maths/moment';
import { noRows, type Rows } from '../../src/maths/rows';

function rows(): Rows {
  const all = noRows();
  all.length = 3;
  all.columns.update = [1, 2, 5];
  all.columns.steps = [512, 1024, 2560];
  all.columns.episodes = [10, 22, 60];
  all.columns.wall = [0.5, 1.0004567, 2.5];
  return all;
}

describe('momentAt', () => {
  it('is what the nearest update said', () => {
    expect(momentAt(rows(), 'steps', 1024)).toEqual({ update: 2, steps: 1024, episodes: 22, wall: 1.0004567 });
    expect(momentAt(rows(), 'steps', 1791)).toMatchObject({ update: 2 });
    expect(momentAt(rows(), 'steps', 1793)).toMatchObject({ update: 5 });
    expect(momentAt(rows(), 'wall', 2.5)).toMatchObject({ update: 5 });
    expect(momentAt(rows(), 'episodes', 1e9)).toMatchObject({ update: 5 });
  });
  it('is the first update before it, and none without updates', () => {
    expect(momentAt(rows(), 'wall', 0)).toMatchObject({ update: 1 });
    expect(momentAt(noRows(), 'steps', 5)).toBeNull();
  });
  it('is the same moment on each axis', () => {
    for (const x of ['update', 'steps', 'episodes', 'wall'] as const) {
      const moment = momentAt(rows(), 'steps', 1024);
      expect(momentAt(rows(), x, Number(pointText(x, moment?.[x] ?? NaN)))).toEqual(moment);
    }
  });
});

it('a point is short in the address', () => {
  expect(pointText('steps', 51_199.6)).toBe('51200');
  expect(pointText('wall', 1.23456)).toBe('1.235');
  expect(pointText('wall', 2)).toBe('2');
  expect(momentName('steps', 51_200)).toBe('51.2k steps');
  expect(momentName('wall', 12.34)).toBe('12.3 s');
});

describe('evaluationUntil', () => {
  const one = (policy: string, update: number, traversal = 'summer', shuffled = false): Evaluation => ({ policy, update, traversal, shuffled }) as Evaluation;
  const list = [one('blind', 0), one('net', 5), one('net', 10), one('net', 20), one('net', 10, 'winter'), one('net', 20, 'summer', true)];
  it('is the newest one of the agent up to an update', () => {
    expect(evaluationUntil(list, 'summer', 19)).toBe(list[2]);
    expect(evaluationUntil(list, 'summer', null)).toBe(list[3]);
    expect(evaluationUntil(list, 'winter', 100)).toBe(list[4]);
    expect(evaluationUntil(list, null, 20)).toBe(list[3]);
  });
  it('is none before the first, whatever controls did', () => {
    expect(evaluationUntil(list, 'summer', 4)).toBeNull();
  });
});
