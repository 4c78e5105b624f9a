// SPDX-License-Identifier: Apache-2.0
/**
 * Exponential moving average, debiased: the weights of what there is so far add up to 1, so that the start is not drawn
 * towards zero. `smoothing` is the weight that one update keeps at the next (0: none; the paper's curves have 0.9). Where
 * rows are missing (a decimated series) the weight decays by the updates between, `at` (ascending). Gaps (null) stay gaps.
 */
export function smooth(values: readonly (number | null)[], at: readonly number[], smoothing: number): (number | null)[] {
  if (smoothing <= 0) return values.slice();
  let sum = 0;
  let weight = 0;
  let last: number | null = null;
  return values.map((value, i) => {
    if (value === null || Number.isNaN(value)) return null;
    const now = at[i] ?? i;
    const decay = last === null ? 0 : smoothing ** Math.max(now - last, 0);
    last = now;
    sum = sum * decay + value * (1 - smoothing);
    weight = weight * decay + (1 - smoothing);
    return sum / weight;
  });
}
