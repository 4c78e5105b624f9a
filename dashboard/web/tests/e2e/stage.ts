// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { chromium, type Browser, type BrowserContextOptions, type Page } from 'playwright-core';
import { afterAll, afterEach, beforeAll, inject } from 'vitest';
import { Mock, type MockOptions } from '../../mock/server';

// CITYLEARN_DASHBOARD: address of a dashboard to test in place of the mock. Specs that need to kill something are then skipped.
const ADDRESS = process.env.CITYLEARN_DASHBOARD ? new URL('/', process.env.CITYLEARN_DASHBOARD).href : undefined;
export const onMock = ADDRESS === undefined;

export interface Opened {
  page: Page;
  /** Console messages of level error or warning, failed scripts, violations of the CSP. */
  complaints: string[];
  /** Addresses that were asked for, of other servers than the dashboard. */
  outside: string[];
}

/** A dashboard and a browser for the specs of a file or of a `describe`. */
export class Stage {
  private browser!: Browser;
  private mock: Mock | null = null;
  url = ADDRESS ?? '';

  /** Opens both before the specs that follow, closes their pages after each, and both in the end. */
  static forSpecs(options: Partial<MockOptions> = {}): Stage {
    const stage = new Stage();
    beforeAll(async () => {
      stage.browser = await chromium.connect(inject('browser'));
      if (ADDRESS) return;
      stage.mock = await Mock.start({ port: 0, page: process.env.CITYLEARN_PAGE ?? 'dist', ...options });
      stage.url = stage.mock.url;
    });
    afterEach(() => Promise.all(stage.browser.contexts().map((context) => context.close())));
    afterAll(async () => {
      await stage.browser.close();
      await stage.mock?.stop();
    });
    return stage;
  }

  /** The mock; there is none in front of a real dashboard. */
  get dashboard(): Mock {
    if (!this.mock) throw new Error('this spec needs the mock');
    return this.mock;
  }

  async page(hash: string, options: BrowserContextOptions = {}): Promise<Opened> {
    const context = await this.browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
    const page = await context.newPage();
    page.setDefaultTimeout(10_000);
    const complaints: string[] = [];
    const outside: string[] = [];
    page.on('console', (message) => {
      // The browser notes each 503; here it means "is being fetched", and the page asks again.
      if (/status of 503/.test(message.text())) return;
      if (message.type() === 'error' || message.type() === 'warning') complaints.push(message.text());
    });
    page.on('pageerror', (error) => complaints.push(error.message));
    page.on('request', (request) => {
      const url = request.url();
      if (!url.startsWith(this.url) && !url.startsWith('blob:') && !url.startsWith('data:')) outside.push(url);
    });
    await page.goto(`${this.url}#/${hash}`);
    return { page, complaints, outside };
  }
}

/** Returns how far a page is wider than its window. */
export const wider = (page: Page): Promise<number> => page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);

/** Repeats a call until its result satisfies the condition, for at most 10 s. */
export async function eventually<T>(what: () => Promise<T>, satisfies: (value: T) => boolean, limit = 10_000): Promise<T> {
  const end = Date.now() + limit;
  for (;;) {
    const value = await what();
    if (satisfies(value)) return value;
    if (Date.now() > end) throw new Error(`not within ${limit} ms; last: ${JSON.stringify(value)}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

/** Returns what axe finds wrong with an open page, one line per rule. */
export async function violations(page: Page): Promise<string[]> {
  const source = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
  // As a script of the debugger: the page's CSP forbids any of its own.
  await page.evaluate(source);
  return page.evaluate(async () => {
    interface Axe {
      run(): Promise<{ violations: { id: string; help: string; nodes: { target: string[]; html: string }[] }[] }>;
    }
    const { axe } = window as unknown as { axe: Axe };
    const result = await axe.run();
    return result.violations.map((v) => `${v.id}: ${v.help}: ${v.nodes.slice(0, 3).map((n) => `${n.target.join(' ')} ${n.html.slice(0, 120)}`).join(' | ')}`);
  });
}
