// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { PAGES } from '../chromium';
import { onMock, Stage, violations } from './stage';

describe.runIf(onMock)('a dashboard that has heard nothing yet', () => {
  const stage = Stage.forSpecs({ empty: true });

  it.each(PAGES)('%s says what to do', async (name) => {
    const { page, complaints } = await stage.page(name);
    await page.waitForSelector('.empty');
    expect((await page.locator('.empty').first().innerText()).length).toBeGreaterThan(15);
    expect(complaints).toEqual([]);
    if (name === 'overview') expect(await violations(page)).toEqual([]);
  });
});

describe.runIf(onMock)('a dashboard with a token', () => {
  const stage = Stage.forSpecs({ token: 'open-sesame' });

  it('asks for it, refuses a wrong one, and is live with the right one', async () => {
    const { page, outside } = await stage.page('overview');
    const field = page.getByLabel('Token');
    await field.fill('wrong');
    expect(await violations(page)).toEqual([]);
    await page.getByRole('button', { name: 'Open' }).click();
    await page.getByText('The token is wrong.').waitFor();
    await field.fill('open-sesame');
    await page.getByRole('button', { name: 'Open' }).click();
    await page.locator('[data-link="open"]').waitFor();
    await page.waitForSelector('.run-card');
    expect(stage.dashboard.asked.some((one) => one.includes('open-sesame'))).toBe(false);
    expect(outside).toEqual([]);
    // The cookie opens the next page, and the pictures.
    await page.goto(`${stage.url}#/route`);
    await page.reload();
    await page.waitForSelector('.picture img');
  });
});

describe.runIf(onMock)('what the server refuses', () => {
  const stage = Stage.forSpecs();

  it('is told where it would have stood', async () => {
    const { page } = await stage.page('overview');
    await page.waitForSelector('.run-card');
    await page.route('**/evaluations', (route) => route.fulfill({ status: 503, json: { error: 'the store is being repaired' } }));
    await page.goto(`${stage.url}#/deployment`);
    await page.locator('.failed', { hasText: 'the store is being repaired' }).waitFor();
    // The rest of the page is there.
    await page.locator('#episodes tbody tr').first().waitFor();
  });

  it('is asked for again where it is on its way', async () => {
    const { page } = await stage.page('overview');
    let times = 0;
    await page.route('**/api/map/*', async (route) => {
      if (++times === 1) await route.fulfill({ status: 503, headers: { 'Retry-After': '1' }, json: { error: 'is being fetched' } });
      else await route.continue();
    });
    await page.goto(`${stage.url}#/route`);
    await page.getByRole('img', { name: /Map, north up/ }).waitFor();
    expect(times).toBeGreaterThan(1);
  });
});
