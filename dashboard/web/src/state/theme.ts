// SPDX-License-Identifier: Apache-2.0
import { effect, signal } from '@preact/signals';

export type Theme = 'auto' | 'light' | 'dark';

const KEY = 'citylearn-theme';
const dark = window.matchMedia('(prefers-color-scheme: dark)');

function remembered(): Theme {
  try {
    const value = localStorage.getItem(KEY);
    return value === 'light' || value === 'dark' ? value : 'auto';
  } catch {
    return 'auto'; // storage forbidden
  }
}

export const theme = signal<Theme>(remembered());
/** The theme that is shown. Canvases depend on it. */
export const shown = signal<'light' | 'dark'>('light');

export function startTheme(): void {
  const apply = (): void => {
    shown.value = theme.value === 'auto' ? (dark.matches ? 'dark' : 'light') : theme.value;
    document.documentElement.dataset.theme = shown.value;
    try {
      if (theme.value === 'auto') localStorage.removeItem(KEY);
      else localStorage.setItem(KEY, theme.value);
    } catch {
      // Storage forbidden: the choice lasts as long as the page.
    }
  };
  dark.addEventListener('change', apply);
  effect(apply);
}

/** Returns the name of the n-th line's colour; after eight they repeat. */
export function seriesColour(n: number): string {
  return `series-${(n % 8) + 1}`;
}

const probe = document.createElement('i');

/** Returns a colour of the design system for a canvas, as the theme that is shown has it: "rgb(21, 36, 43)". */
export function colour(name: string): string {
  if (!probe.isConnected) document.head.append(probe);
  probe.style.color = `var(--${name})`;
  return getComputedStyle(probe).color;
}
