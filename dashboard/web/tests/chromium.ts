// SPDX-License-Identifier: Apache-2.0
import { existsSync } from 'node:fs';

/** Debian's chromium, or the one that CITYLEARN_CHROMIUM names. */
export function executable(): string {
  const path = process.env.CITYLEARN_CHROMIUM ?? '/usr/bin/chromium';
  if (!existsSync(path)) throw new Error(`there is no ${path}: install chromium or set CITYLEARN_CHROMIUM`);
  return path;
}

// A container has no sandbox and no GPU; nothing may be asked of anybody but the dashboard.
export const ARGS = [
  '--headless',
  '--no-sandbox',
  '--disable-gpu',
  '--disable-quic',
  '--no-first-run',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
];

export const PAGES = ['overview', 'training', 'route', 'deployment', 'compare'] as const;
