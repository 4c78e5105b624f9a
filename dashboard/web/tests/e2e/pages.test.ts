// SPDX-License-Identifier: Apache-2.0
import { expect, it } from 'vitest';
import { PAGES } from '../chromium';
import { eventually, Stage, violations, wider } from './stage';

const stage = Stage.ofCity();

it.each(PAGES)('%s shows its content, asks nobody else, and is fine in the dark and at 400 and 2560 pixels', async (name) => {
  const { page, complaints, outside } = await stage.page(name);
  const fine = async (): Promise<void> => {
    await eventually(() => wider(page), (pixels) => pixels <= 0);
    expect(await violations(page)).toEqual([]);
  };
  await page.waitForFunction(() => document.querySelector('[data-link="open"]') && !document.querySelector('.loading'));
  await page.waitForFunction(() => (document.querySelector('main')?.textContent?.length ?? 0) > 200);
  expect(await page.locator('.failed').count()).toBe(0);
  await fine();
  await page.emulateMedia({ colorScheme: 'dark' });
  await page.waitForFunction(() => matchMedia('(prefers-color-scheme: dark)').matches);
  await page.setViewportSize({ width: 400, height: 800 });
  await fine();
  await page.setViewportSize({ width: 2560, height: 1300 });
  await eventually(() => wider(page), (pixels) => pixels <= 0);
  expect(complaints).toEqual([]);
  expect(outside).toEqual([]);
});
