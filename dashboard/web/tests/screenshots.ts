// SPDX-License-Identifier: Apache-2.0
import { mkdirSync, statSync } from 'node:fs';
import { resolve } from 'node:path';
import { chromium } from 'playwright-core';
import { Mock } from '../mock/server';
import { ARGS, executable, PAGES } from './chromium';

// npm run screenshots [-- FOLDER [WIDTHxHEIGHT ...]]: a picture of each page, light and dark. CITYLEARN_DASHBOARD is the address of the
// dashboard that they are taken of; without it, the built page before the mock.
const [folder = '../../docs/pictures/dashboard', ...sizes] = process.argv.slice(2).filter((arg) => arg !== '--');
const MOST = 300_000; // bytes of a picture

type Places = Record<(typeof PAGES)[number], string>;
const MOCKED: Places = {
  overview: 'overview',
  training: 'training?groups=' + encodeURIComponent(['demo-2211', 'features-1830'].map((run, i) => JSON.stringify([run, 'policy', i ? 'features · ppo' : 'place_filter · ppo'])).join('\n')),
  route: 'route',
  deployment: `deployment?run=${encodeURIComponent('demo-2211/policy/1/1763740800000000')}`,
  recognition: 'recognition',
  compare: 'compare',
};

const address = process.env.CITYLEARN_DASHBOARD && new URL('/', process.env.CITYLEARN_DASHBOARD).href;
const places = address ? (Object.fromEntries(PAGES.map((name) => [name, name])) as Places) : MOCKED;
const mock = address ? undefined : await Mock.start({ port: 0, page: process.env.CITYLEARN_PAGE ?? 'dist' });
const url = address ?? mock?.url;
const browser = await chromium.launch({ executablePath: executable(), args: ARGS });
mkdirSync(folder, { recursive: true });
let failed = false;
for (const size of sizes.length ? sizes : ['1280x800']) {
  const [width = 1280, height = 860] = size.split('x').map(Number);
  for (const colorScheme of ['light', 'dark'] as const) {
    const page = await browser.newPage({ viewport: { width, height }, colorScheme });
    for (const name of PAGES) {
      await page.goto(`${url}#/${places[name]}`);
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
await mock?.stop();
if (failed) console.error(`a picture is larger than ${MOST} bytes`);
process.exit(failed ? 1 : 0);
