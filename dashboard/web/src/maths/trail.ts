// SPDX-License-Identifier: Apache-2.0
import { FLAG_FIRST, FLAG_IDLE, LATER_GOAL, type Scene, type SceneAgent } from '../api/types';

/**
 * An agent's positions at some steps of its episode, as scenes arrive less often than steps; its goal, and how many
 * follow.
 */
export interface Trail {
  start: number;
  goal: number;
  later: number;
  steps: number[];
  positions: number[];
}

const LONGEST = 4096;

/**
 * Returns the trail after one more scene. Another start, a goal that does not follow, a count of steps that fell, or the
 * first observation begins a new one.
 */
export function extend(trail: Trail | undefined, agent: SceneAgent): Trail {
  const last = trail?.steps[trail.steps.length - 1] ?? -1;
  const later = laterGoals(agent);
  const same =
    trail !== undefined &&
    trail.start === agent.start &&
    (trail.goal === agent.goal || later < trail.later) &&
    agent.steps >= last &&
    (agent.flags & FLAG_FIRST) === 0;
  if (!same) {
    const begun = { start: agent.start, goal: agent.goal, later, steps: [0], positions: [agent.start] };
    if (agent.steps > 0) push(begun, agent);
    return begun;
  }
  trail.goal = agent.goal;
  trail.later = later;
  if (agent.steps > last) push(trail, agent);
  return trail;
}

function push(trail: Trail, agent: SceneAgent): void {
  if (trail.steps.length >= LONGEST) {
    trail.steps.splice(1, 1);
    trail.positions.splice(1, 1);
  }
  trail.steps.push(agent.steps);
  trail.positions.push(agent.position);
}

/** The trails of all agents of one env_service. Another traversal or route starts new ones. */
export class Trails {
  private key = '';
  private trails: Trail[] = [];

  add(scene: Scene): void {
    const key = `${scene.traversal} ${scene.hash} ${scene.first_frame} ${scene.frames} ${scene.policy} ${scene.mode}`;
    if (key !== this.key || scene.list.length !== this.trails.length) this.trails = [];
    this.key = key;
    this.trails = scene.list.map((agent, i) => extend(this.trails[i], agent));
  }

  of(agent: number): Trail | undefined {
    return this.trails[agent];
  }
}

/** Returns how many goals follow the present one in the episode. */
export function laterGoals(agent: SceneAgent): number {
  return Math.floor(agent.flags / LATER_GOAL);
}

export function idle(agent: SceneAgent): boolean {
  return (agent.flags & FLAG_IDLE) !== 0;
}
