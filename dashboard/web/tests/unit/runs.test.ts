// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { backOff } from '../../src/api/live';
import type { Manifest, Run, RunDetail, RunTraversal, Scene, SceneAgent } from '../../src/api/types';
import { groupRuns, namesakes, preferredGroup, settingsOf } from '../../src/maths/groups';
import { meanRate, preferredRun, runName } from '../../src/maths/runs';
import { artefactsOf, compareManifests } from '../../src/maths/manifest';
import { beliefText, routePart, sameTraversal, sceneText } from '../../src/maths/scene';
import { extend, Trails } from '../../src/maths/trail';
import { toneOf } from '../../src/ui/basics';

function run(session: string, seed: number, agent: string): Run {
  return { id: `${session}/policy/${seed}`, session, policy: 'policy', seed, agent, learner: 'ppo', started: 0 } as Run;
}

describe('groupRuns', () => {
  const runs = [run('b', 2, 'x'), run('b', 1, 'x'), run('a', 3, 'x'), run('a', 1, 'y')];
  it('by sweep: one policy_service and agent, seeds in order', () => {
    expect(groupRuns(runs, 'sweep').map((group) => group.runs.map((one) => one.id))).toEqual([
      ['b/policy/1', 'b/policy/2'],
      ['a/policy/3'],
      ['a/policy/1'],
    ]);
  });
  it('by agent and learner', () => {
    expect(groupRuns(runs, 'agent').map((group) => [group.label, group.runs.length])).toEqual([
      ['x · ppo', 3],
      ['y · ppo', 1],
    ]);
  });
});

it('preferredRun: the newest in a state, one without a policy_service last', () => {
  const stray = { ...run('a', 9, ''), policy: null, state: 'running' } as Run;
  const [running, ended] = [{ ...run('b', 1, 'x'), state: 'running' }, { ...run('c', 2, 'x'), state: 'ended' }] as [Run, Run];
  expect(preferredRun([stray, ended, running], 'running')).toBe(running);
  expect(preferredRun([stray, running, ended], 'ended')).toBe(ended);
  expect(preferredRun([stray, ended], 'running')).toBe(stray);
});

it('curves are first those of the newest run of which more than episodes is known', () => {
  const unknown = { ...run('c', 1, ''), policy: null };
  expect(preferredGroup(groupRuns([unknown, run('b', 1, 'x')], 'sweep'))?.runs[0]?.session).toBe('b');
  expect(preferredGroup(groupRuns([unknown], 'sweep'))?.runs).toEqual([unknown]);
});

describe('seeds of one setting', () => {
  const one = (seed: number, id: string): Run => ({ ...run('b', seed, 'x'), id, started: 60 * Number(id) });
  const ids = (runs: Run[], settings?: Map<string, string>): string[] =>
    groupRuns(runs, 'sweep', settings).map((group) => group.runs.map(({ id }) => id).join());
  it('runs of one name with other options are not seeds of one group', () => {
    const runs = [one(3, '3'), one(2, '2'), one(1, '1')];
    expect(ids(runs)).toEqual(['1,2,3']);
    const clips = [['1', 0.2], ['2', 0.1], ['3', 0.2]] as const;
    const settings = new Map(clips.map(([id, clip]) => [id, settingsOf({ seed: Number(id), job: id, parameters: { clip } })]));
    expect(ids(runs, settings)).toEqual(['1,3', '2']);
    const [first, second] = groupRuns(runs, 'sweep', settings);
    expect(first?.label).not.toBe(second?.label);
    expect(first?.key).toBe(groupRuns(runs, 'sweep')[0]?.key);
    expect(second?.key).not.toBe(first?.key);
  });
  it('a seed counts once: a sweep that is run again is another group', () => {
    expect(ids([one(2, '4'), one(1, '3'), one(2, '2'), one(1, '1')])).toEqual(['3,4', '1,2']);
  });
  it('traversals that are not trained on say nothing about the settings', () => {
    const of = (traversals: Manifest): string => settingsOf({ seed: 1, train: 'summer, fall', traversals });
    expect(of({ summer: { hash: 'a' } })).toBe(of({ rain: { hash: 'b' }, summer: { hash: 'a' } }));
    expect(of({ summer: { hash: 'a' } })).not.toBe(of({ summer: { hash: 'b' } }));
  });
  it('manifests are needed of namesakes alone', () => {
    const runs = [one(2, '2'), run('a', 1, 'x'), one(1, '1')];
    expect(namesakes(runs, 'sweep').map(({ id }) => id)).toEqual(['2', '1']);
    expect(namesakes(runs, 'agent')).toEqual(runs);
  });
});

describe('runs', () => {
  it('a name says which of its words is the session: a session may be named as a middleware is', () => {
    expect(runName({ agent: 'place_filter', learner: 'ppo', seed: 1, session: 'cyclonedds' })).toBe(
      'place_filter · ppo · seed 1 · session cyclonedds',
    );
    expect(groupRuns([run('cyclonedds', 1, 'x')], 'sweep')[0]?.label).toBe('x · ppo · session cyclonedds');
  });
  it('the steps per second are those of the whole run, not of its last update', () => {
    expect(meanRate({ steps: 3000, wall: 2, steps_per_second: 9 } as Run)).toBe(1500);
    expect(meanRate({ steps: 0, wall: 0 })).toBeNull();
    expect(meanRate({ steps: null, wall: null })).toBeNull();
  });
});

describe('tones', () => {
  it.each(['starting', 'waiting', 'stopping', 'stopped'])('a service that is %s is healthy, and not amber', (state) =>
    expect(toneOf(state)).toBeUndefined(),
  );
  it('what needs attention has a colour', () => {
    expect(toneOf('running')).toBe('tone-good');
    expect(toneOf('restarted')).toBe('tone-warn');
    for (const state of ['lost', 'failed', 'alarm']) expect(toneOf(state)).toBe('tone-bad');
  });
});

describe('scenes', () => {
  const traversal = { frames: 1000 } as RunTraversal;
  const scene = { first_frame: 17, frames: 128, step: 12, mode: 'train', policy: 'features' } as Scene;
  const idle = { first_frame: 0, frames: 0, step: 0, mode: 'idle', policy: '' } as Scene; // an env_service without settings
  const detail = { manifest: { first_frame: 5, frames: 64 } } as unknown as RunDetail;
  it('say what the agents do, and where', () => {
    expect(sceneText(scene, traversal)).toBe('training features · frames 17 to 144 · tick 12');
    expect(routePart(scene, detail, traversal)).toEqual({ first: 17, count: 128 });
  });
  it('without settings have no frames or ticks to name', () => {
    expect(sceneText(idle, traversal)).toBe('idle · 1,000 frames');
    expect(routePart(idle, detail, traversal)).toEqual({ first: 5, count: 64 });
    expect(sceneText(null, traversal)).toBe('1,000 frames');
    expect(routePart(null, { manifest: null } as RunDetail, traversal)).toEqual({ first: 0, count: 1000 });
  });
  it('say what an agent believes', () => {
    const places = [{ frame: 41, probability: 0.7 }];
    const text = 'sure to 93 % that it is within one place of 41; entropy 0.4 bits';
    expect(beliefText({ places, entropy: 0.42, lost: 0.0625 })).toBe(text);
    expect(beliefText({ places, entropy: 0, lost: 0.001 })).toContain('sure to 99 %');
  });
});

describe('trails', () => {
  const agent = (changes: Partial<SceneAgent>): SceneAgent => ({ frame: 5, position: 5, start: 5, goal: 9, steps: 0, flags: 1, ...changes });
  it('collects positions of an episode, also when it was seen late', () => {
    const trail = extend(undefined, agent({ position: 7, steps: 2, flags: 0 }));
    expect(trail).toEqual({ start: 5, goal: 9, later: 0, steps: [0, 2], positions: [5, 7] });
    extend(trail, agent({ position: 8, steps: 3, flags: 0 }));
    extend(trail, agent({ position: 8, steps: 3, flags: 0 })); // the same once more
    expect(trail.positions).toEqual([5, 7, 8]);
  });
  it.each([
    ['another goal', agent({ goal: 2, steps: 9, flags: 0 })],
    ['fewer steps', agent({ steps: 1, flags: 0 })],
    ['a first observation', agent({ steps: 0, flags: 1 })],
  ])('begins anew with %s', (_, next) => {
    const old = extend(extend(undefined, agent({})), agent({ position: 6, steps: 3, flags: 0 }));
    expect(extend(old, next)).not.toBe(old);
  });
  it('goes on to the next of several goals', () => {
    const old = extend(extend(undefined, agent({ flags: 33 })), agent({ position: 9, steps: 4, flags: 32 }));
    expect(extend(old, agent({ goal: 2, position: 8, steps: 5, flags: 16 }))).toBe(old);
    expect(old).toEqual({ start: 5, goal: 2, later: 1, steps: [0, 4, 5], positions: [5, 9, 8] });
    expect(extend(old, agent({ goal: 7, steps: 9, flags: 32 }))).not.toBe(old);
  });
  it('begins anew on another route', () => {
    const trails = new Trails();
    const scene = { traversal: 'a', hash: '1', first_frame: 0, frames: 9, step: 1, mode: 'train', policy: 'p', agents: 1 };
    trails.add({ ...scene, list: [agent({ position: 6, steps: 1, flags: 0 })] });
    trails.add({ ...scene, list: [agent({ position: 7, steps: 2, flags: 0 })] });
    expect(trails.of(0)?.positions).toEqual([5, 6, 7]);
    trails.add({ ...scene, hash: '2', list: [agent({ position: 7, steps: 3, flags: 0 })] });
    expect(trails.of(0)?.positions).toEqual([5, 7]);
  });
});

it('backs off from half a second to ten, less a little by chance', () => {
  expect([1, 2, 3, 4, 5, 6, 20].map((n) => backOff(n, 0))).toEqual([500, 1000, 2000, 4000, 8000, 10_000, 10_000]);
  expect(backOff(1, 1)).toBe(375);
});

describe('files of a run', () => {
  const artefacts = { host: 'lab', folder: '/runs/a', names: ['summary.json', 'checkpoints'] };
  it('have whole paths', () => {
    expect(artefactsOf({ artefacts })).toEqual({ host: 'lab', paths: ['/runs/a/summary.json', '/runs/a/checkpoints'] });
  });
  it('are unknown where a manifest says something else', () => {
    for (const said of [null, 5, 'a', [], {}, { ...artefacts, names: 'a' }, { ...artefacts, folder: null }])
      expect(artefactsOf({ artefacts: said } as Manifest)).toBeNull();
    expect(artefactsOf(null)).toBeNull();
    expect(artefactsOf({ artefacts: { ...artefacts, names: [5, 'b'] } })?.paths).toEqual(['/runs/a/b']);
  });
  it('are no options', () => {
    expect(settingsOf({ agent: 'a', artefacts })).toBe(settingsOf({ agent: 'a' }));
  });
});

it('traversals of equal contents are two', () => {
  const summer = { traversal: 'summer', hash: '0a' };
  expect(sameTraversal(summer, { ...summer })).toBe(true);
  expect(sameTraversal(summer, { traversal: 'winter', hash: '0a' })).toBe(false);
  expect(sameTraversal(summer, { traversal: 'summer', hash: '0b' })).toBe(false); // other frames
});

describe('manifests', () => {
  const one = (rate: number): Manifest => ({ rate, net: { width: 8, layers: [1, 'x'] }, artefacts: { folder: String(rate) } });
  it('are compared by their leaves', () => {
    expect(compareManifests([one(0.1), one(0.2)])).toEqual([
      { key: 'net.layers', values: ['1, x', '1, x'], differs: false },
      { key: 'net.width', values: ['8', '8'], differs: false },
      { key: 'rate', values: ['0.1', '0.2'], differs: true },
    ]);
    expect(compareManifests([{ a: 1 }, { b: 1 }]).map(({ values, differs }) => [...values, differs])).toEqual([['1', null, true], [null, '1', true]]);
  });
  it('that are not known differ in nothing', () => {
    expect(compareManifests([one(0.1), null]).some(({ differs }) => differs)).toBe(false);
  });
});
