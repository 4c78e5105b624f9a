// SPDX-License-Identifier: Apache-2.0
// Choices that are parameters of the address.

import type { JSX } from 'preact';
import { duration, short } from '../maths/format';
import type { XAxis } from '../maths/rows';
import { param, setParams } from '../state/router';

/** A choice by its parameter and its values with their labels. The first value is the default. */
export interface ChoiceOf<T extends string> {
  name: string;
  label: string;
  values: Record<T, string>;
  /** Parameters that a change removes. */
  resets?: readonly string[];
}

const valuesOf = <T extends string>(choice: ChoiceOf<T>): T[] => Object.keys(choice.values) as T[];

export function chosen<T extends string>(choice: ChoiceOf<T>): T {
  const all = valuesOf(choice);
  const wanted = param(choice.name, '');
  return all.find((value) => value === wanted) ?? (all[0] as T);
}

/** A choice among a few visible options. */
export function Choice<T extends string>({ of }: { of: ChoiceOf<T> }): JSX.Element {
  const select = (value: T): void => {
    setParams({ ...Object.fromEntries((of.resets ?? []).map((name) => [name, null])), [of.name]: value });
  };
  return (
    <fieldset class="hint">
      <legend>{of.label}</legend>
      <div class="framed segments">
        {valuesOf(of).map((value) => (
          <label key={value}>
            <input class="visually-hidden" type="radio" name={of.name} value={value} checked={value === chosen(of)} onChange={() => select(value)} />
            {of.values[value]}
          </label>
        ))}
      </div>
    </fieldset>
  );
}

/** Returns how a chart names and writes an axis of training curves. */
export function axisProps(x: XAxis): { xLabel: string; xFormat: (value: number) => string } {
  return x === 'wall' ? { xLabel: 'wall time', xFormat: duration } : { xLabel: x, xFormat: short };
}

/** The horizontal axis of training curves. */
export const AXIS: ChoiceOf<Exclude<XAxis, 'update'>> = {
  name: 'x',
  label: 'Horizontal axis',
  values: { steps: 'Steps', episodes: 'Episodes', wall: 'Time' },
};

/** Which episodes of a run. */
export const KIND: ChoiceOf<'evaluation' | 'training'> = { name: 'kind', label: 'Episodes of', values: { evaluation: 'Evaluation', training: 'Training' } };

export const GROUPS: ChoiceOf<'sweep' | 'agent'> = {
  name: 'by',
  label: 'Group seeds by',
  values: { sweep: 'Sweep', agent: 'Agent and learner' },
  resets: ['groups'],
};
