// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { PAGES } from '../chromium';
import { Stage, violations } from './stage';

describe('a dashboard that has heard nothing yet', () => {
  const stage = Stage.ofProgram({ middleware: 'inprocess' });

  it('says what to do, on each page', async () => {
    const { page, complaints } = await stage.page('overview');
    for (const name of PAGES) {
      await page.goto(`${stage.url}#/${name}`);
      await page.waitForFunction((href) => document.querySelector(`nav [aria-current][href="${href}"]`) && document.querySelector('.empty'), `#/${name}`);
      expect((await page.locator('.empty').first().innerText()).length, name).toBeGreaterThan(15);
      if (name === 'overview') expect(await violations(page)).toEqual([]);
    }
    expect(complaints).toEqual([]);
  });
});

describe('what the server refuses', () => {
  const stage = Stage.ofCity();

  it('is asked for again where it is on its way', async () => {
    const { page } = await stage.page('overview');
    let times = 0;
    await page.route('**/api/map/*', async (route) => {
      if (++times === 1) await route.fulfill({ status: 503, headers: { 'Retry-After': '1' }, json: { error: 'is being fetched' } });
      else await route.continue();
    });
    await page.goto(`${stage.url}#/route`);
    await page.locator('.map .scale', { hasText: /\d m$/ }).first().waitFor();
    expect(times).toBeGreaterThan(1);
  });
});
