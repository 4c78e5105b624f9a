// SPDX-License-Identifier: Apache-2.0
// Choices that are parameters of the address.

import type { JSX } from 'preact';
import type { XAxis } from '../maths/rows';
import { param, setParams } from '../state/router';
import { Segmented } from './basics';

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

export function Choice<T extends string>({ of, onChange }: { of: ChoiceOf<T>; onChange?: () => void }): JSX.Element {
  return (
    <Segmented
      label={of.label}
      value={chosen(of)}
      options={valuesOf(of).map((value) => ({ value, label: of.values[value] }))}
      onChange={(value) => {
        onChange?.();
        setParams({ ...Object.fromEntries((of.resets ?? []).map((name) => [name, null])), [of.name]: value });
      }}
    />
  );
}

/** The horizontal axis of training curves. */
export const AXIS: ChoiceOf<Exclude<XAxis, 'update'>> = {
  name: 'x',
  label: 'Horizontal axis',
  values: { steps: 'Steps', episodes: 'Episodes', wall: 'Time' },
};

export const GROUPS: ChoiceOf<'sweep' | 'agent'> = {
  name: 'by',
  label: 'Group seeds by',
  values: { sweep: 'Sweep', agent: 'Agent and learner' },
  resets: ['groups'],
};
