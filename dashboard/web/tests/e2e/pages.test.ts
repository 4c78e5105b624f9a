// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Page } from 'playwright-core';
import { PAGES } from '../chromium';
import { Stage, violations, wider } from './stage';

const stage = Stage.forSpecs();

/** Waits until nothing of the page is still on its way. */
async function settled(page: Page): Promise<void> {
  await page.waitForSelector('h1');
  await page.waitForFunction(() => document.querySelector('[data-link="open"]') && !document.querySelector('.loading'));
}

describe.each(PAGES)('%s', (name) => {
  it('shows its content without a complaint, and asks nobody else', async () => {
    const { page, complaints, outside } = await stage.page(name);
    await settled(page);
    await page.waitForFunction(() => (document.querySelector('main')?.textContent?.length ?? 0) > 200);
    expect(await page.locator('.failed').count()).toBe(0);
    expect(complaints).toEqual([]);
    expect(outside).toEqual([]);
    expect(await wider(page)).toBeLessThanOrEqual(0);
    expect(await violations(page)).toEqual([]);
  });

  it('is fine in the dark and at 400 pixels', async () => {
    const { page, complaints } = await stage.page(name, { colorScheme: 'dark', viewport: { width: 400, height: 800 } });
    await settled(page);
    expect(await page.evaluate(() => document.documentElement.dataset.theme)).toBe('dark');
    expect(await wider(page)).toBeLessThanOrEqual(0);
    expect(await violations(page)).toEqual([]);
    expect(complaints).toEqual([]);
  });
});

it('works at 2560 pixels', async () => {
  const { page } = await stage.page('training', { viewport: { width: 2560, height: 1300 } });
  await settled(page);
  expect(await wider(page)).toBeLessThanOrEqual(0);
});
