// SPDX-License-Identifier: Apache-2.0
import { expect, it } from 'vitest';
import type { Page } from 'playwright-core';
import { PAGES } from '../chromium';
import { eventually, Stage, violations, wider } from './stage';

const stage = Stage.ofCity();

/** Waits until nothing of the page is still on its way. */
async function settled(page: Page): Promise<void> {
  await page.waitForSelector('h1');
  await page.waitForFunction(() => document.querySelector('[data-link="open"]') && !document.querySelector('.loading'));
}

it.each(PAGES)('%s shows its content, asks nobody else, and is fine in the dark and at 400 pixels', async (name) => {
  const { page, complaints, outside } = await stage.page(name);
  const fine = async (): Promise<void> => {
    await eventually(() => wider(page), (pixels) => pixels <= 0);
    expect(await violations(page)).toEqual([]);
  };
  await settled(page);
  await page.waitForFunction(() => (document.querySelector('main')?.textContent?.length ?? 0) > 200);
  expect(await page.locator('.failed').count()).toBe(0);
  await fine();
  await page.emulateMedia({ colorScheme: 'dark' });
  await page.waitForFunction(() => document.documentElement.dataset.theme === 'dark');
  await page.setViewportSize({ width: 400, height: 800 });
  await fine();
  expect(complaints).toEqual([]);
  expect(outside).toEqual([]);
});

it('works at 2560 pixels', async () => {
  const { page } = await stage.page('training');
  await page.setViewportSize({ width: 2560, height: 1300 });
  await settled(page);
  expect(await wider(page)).toBeLessThanOrEqual(0);
});
