// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import type { Curve } from '../maths/seeds';

/** A small line without axes. The same figures must be given in words beside it. */
export function Spark({ curve, low, high }: { curve: Curve; low: number; high: number }): JSX.Element | null {
  const first = curve.x[0];
  const last = curve.x[curve.x.length - 1];
  if (first === undefined || last === undefined || first === last) return null;
  const stride = Math.max(1, Math.floor(curve.x.length / 160));
  let path = '';
  curve.x.forEach((x, i) => {
    const y = curve.y[i] ?? null;
    if (y === null || (i % stride !== 0 && i !== curve.x.length - 1)) return;
    const height = Math.min(Math.max((y - low) / (high - low), 0), 1);
    path += `${path ? 'L' : 'M'}${((200 * (x - first)) / (last - first)).toFixed(1)} ${(44 - 40 * height).toFixed(1)}`;
  });
  return (
    <svg class="spark" viewBox="0 0 200 48" preserveAspectRatio="none" aria-hidden="true">
      <path d="M0 47H200" stroke="var(--line)" vector-effect="non-scaling-stroke" />
      <path d={path} vector-effect="non-scaling-stroke" />
    </svg>
  );
}
