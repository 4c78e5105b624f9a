// SPDX-License-Identifier: Apache-2.0
// What the curves of training are drawn against.

import type { JSX } from 'preact';

import type { XAxis } from '../maths/rows';
import { Segmented } from './basics';

export function AxisPicker({ value, onChange }: { value: XAxis; onChange: (value: XAxis) => void }): JSX.Element {
  return (
    <Segmented
      label="Horizontal axis"
      value={value}
      options={[
        { value: 'episodes', label: 'Episodes' },
        { value: 'steps', label: 'Steps' },
        { value: 'wall', label: 'Time' },
      ]}
      onChange={onChange}
    />
  );
}
