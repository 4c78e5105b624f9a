// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Evaluation } from '../../src/api/types';
import { byTraversal, checkpoints, evaluationName, newest, splMatrix } from '../../src/maths/evaluations';

function of(policy: string, update: number, traversal: string, shuffled = false): Evaluation {
  return { policy, update, shuffled, traversal } as Evaluation;
}

const list = [
  of('blind', 0, 'winter'),
  of('agent', 10, 'winter'),
  of('agent', 20, 'winter', true),
  of('agent', 20, 'winter'),
  of('shortest_path', 0, 'winter'),
  of('sequence_filter', 0, 'winter'),
  of('oracle_filter', 0, 'winter'),
  of('agent', 10, 'summer'),
];

describe('evaluations', () => {
  it('are named by policy, update and what was shown', () => {
    expect(evaluationName(of('agent', 20, 'winter', true))).toBe('agent, update 20, shuffled frames');
    expect(evaluationName(of('blind', 0, 'winter'))).toBe('blind');
  });
  it('stand by traversal: agents first, the newest checkpoint first, then shuffled, then the controls', () => {
    const groups = byTraversal(list);
    expect([...groups.keys()]).toEqual(['winter', 'summer']);
    expect(groups.get('winter')?.map(evaluationName)).toEqual([
      'agent, update 20',
      'agent, update 10',
      'agent, update 20, shuffled frames',
      'blind',
      'oracle_filter',
      'sequence_filter',
      'shortest_path',
    ]);
  });
  it('of the agent alone make the curve of checkpoints', () => {
    expect(checkpoints(list).get('winter')?.map((one) => one.update)).toEqual([10, 20]);
    expect(newest(list).get('winter')?.update).toBe(20);
    expect(newest(list).get('summer')?.update).toBe(10);
  });
  it('make a matrix: the agent\'s newest checkpoint first, then shuffled, then the controls', () => {
    const spl = new Map([['agent 10 false', 0.5], ['agent 20 false', 0.9], ['agent 20 true', 0.2], ['blind 0 false', 0.7]]);
    const { policies, rows } = splMatrix(list.map((one) => ({ ...one, spl: spl.get(`${one.policy} ${one.update} ${one.shuffled}`) ?? 1 })));
    expect(policies).toEqual(['agent', 'agent, shuffled frames', 'blind', 'oracle_filter', 'sequence_filter', 'shortest_path']);
    const text = rows.map((row) => [row.traversal, ...policies.map((policy) => row.spl.get(policy) ?? '-')].join(' '));
    expect(text).toEqual(['winter 0.9 0.2 0.7 1 1 1', 'summer 0.5 - - - - -']);
  });
});
