// SPDX-License-Identifier: Apache-2.0
import { signal } from '@preact/signals';

const dark = window.matchMedia('(prefers-color-scheme: dark)');
/** Whether the page is dark, as the system is. Canvases depend on it. */
export const isDark = signal(dark.matches);
dark.addEventListener('change', () => (isDark.value = dark.matches));

/** Returns the name of the n-th line's colour; after eight they repeat. */
export function seriesColour(n: number): string {
  return `series-${(n % 8) + 1}`;
}

const probe = document.createElement('i');

/** Returns a colour of the design system for a canvas, as light or dark has it: "rgb(21, 36, 43)". */
export function colour(name: string): string {
  if (!probe.isConnected) document.head.append(probe);
  probe.style.color = `var(--${name})`;
  return getComputedStyle(probe).color;
}
