// SPDX-License-Identifier: Apache-2.0
import { mkdirSync, statSync } from 'node:fs';
import { resolve } from 'node:path';
import { chromium } from 'playwright-core';
import type { Run } from '../src/api/types';
import { ARGS, executable, PAGES } from './chromium';
import { startCity } from './e2e/city';
import { api } from './e2e/programs';

// npm run screenshots [-- FOLDER [WIDTHxHEIGHT ...]]: a picture of each page, light and dark. CITYLEARN_DASHBOARD is the address of the
// dashboard that they are taken of; without it, one with the services of the tests.
const [folder = '../../docs/pictures/dashboard', ...sizes] = process.argv.slice(2).filter((arg) => arg !== '--');
const MOST = 300_000; // bytes of a picture

const started = process.env.CITYLEARN_DASHBOARD ? null : await startCity();
const url = started?.city.url ?? new URL('/', process.env.CITYLEARN_DASHBOARD).href;
// Of several seeds, where there are.
const { runs } = await api<{ runs: Run[] }>(url, 'runs');
const ended = runs.filter(({ state }) => state === 'ended').sort((a, b) => (b.seed ?? 0) - (a.seed ?? 0))[0] ?? runs[0];
const run = ended && encodeURIComponent(ended.id);
const places: Partial<Record<(typeof PAGES)[number], string>> = run ? { training: `training?runs=${run}`, deployment: `deployment?run=${run}` } : {};
const browser = await chromium.launch({ executablePath: executable(), args: ARGS });
mkdirSync(folder, { recursive: true });
let failed = false;
for (const size of sizes.length ? sizes : ['1280x800']) {
  const [width = 1280, height = 860] = size.split('x').map(Number);
  for (const colorScheme of ['light', 'dark'] as const) {
    const page = await browser.newPage({ viewport: { width, height }, colorScheme });
    for (const name of PAGES) {
      await page.goto(`${url}#/${places[name] ?? name}`);
      await page.waitForFunction(() => document.querySelector('[data-link="open"]') && !document.querySelector('.loading'));
      // Agents have walked a little, and every chart in sight is drawn.
      if (name === 'route' && width >= 1200) await page.waitForFunction(() => document.querySelectorAll('.picture img').length === 2);
      await page.waitForTimeout(name === 'route' ? 2500 : 700);
      const path = resolve(folder, `${name}-${sizes.length ? `${width}-` : ''}${colorScheme}.png`);
      await page.screenshot({ path });
      const bytes = statSync(path).size;
      console.log(`${path} ${bytes}`);
      if (bytes > MOST && sizes.length === 0) failed = true;
    }
    await page.close();
  }
}
await browser.close();
await started?.stop();
if (failed) console.error(`a picture is larger than ${MOST} bytes`);
process.exit(failed ? 1 : 0);
