// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { fixed, percent } from '../maths/format';

/** A share as a bar, with its figure. */
export function CompletedBar({ completed }: { completed: number }): JSX.Element {
  return (
    <span class="row bar">
      <svg class="completed" viewBox="0 0 100 8" preserveAspectRatio="none" aria-hidden="true">
        <rect width="100" height="8" rx="2" />
        <rect width={100 * completed} height="8" rx="2" />
      </svg>
      <span class="number">{percent(completed)}</span>
    </span>
  );
}

/** A value between 0 and 1 with its interval, on a scale. */
export function Whisker({ value, low, high }: { value: number; low: number; high: number }): JSX.Element {
  const x = (share: number): number => 3 + 94 * Math.min(Math.max(share, 0), 1);
  const interval = `95 %: ${fixed(low, 3)} to ${fixed(high, 3)}`;
  return (
    <span class="row bar" title={interval}>
      <svg class="whisker" viewBox="0 0 100 14" aria-hidden="true">
        <line x1={x(0)} x2={x(1)} y1="7" y2="7" />
        <line x1={x(low)} x2={x(high)} y1="7" y2="7" class="whisker-interval" />
        <circle cx={x(value)} cy="7" r="3.2" class="whisker-value" />
      </svg>
      <span class="number">{fixed(value, 3)}</span>
      <span class="visually-hidden">, {interval}</span>
    </span>
  );
}

/** A share with a background that is the stronger the nearer it is to 1. */
export function Heat({ share }: { share: number | null }): JSX.Element {
  const strength = share === null ? 0 : Math.round(30 * Math.min(Math.max(share, 0), 1) ** 2);
  return (
    <span class="heat" style={{ background: `color-mix(in srgb, var(--good) ${strength}%, transparent)` }}>
      {fixed(share, 3)}
    </span>
  );
}
