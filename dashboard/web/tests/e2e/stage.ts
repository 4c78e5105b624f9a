// SPDX-License-Identifier: Apache-2.0
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { chromium, type Browser, type BrowserContext, type BrowserContextOptions, type Page, type WebSocketRoute } from 'playwright-core';
import { afterAll, afterEach, beforeAll, inject } from 'vitest';
import { parseFrame } from '../../src/api/frame';
import { frameOf } from '../frame';
import { startDashboard, type Dashboard, type Options } from './programs';

export { api, eventually } from './programs';

export interface Opened {
  page: Page;
  /** Console messages of level error or warning, failed scripts, violations of the CSP. */
  complaints: string[];
  /** Addresses that were asked for, of other servers than the dashboard. */
  outside: string[];
}

/** What stands behind a page while specs run: its address, and how it is stopped. */
interface Behind {
  url: string;
  stop?: () => Promise<void>;
}

/** A dashboard and a browser for the specs of a file or of a `describe`. Pages are closed after each spec. */
export class Stage {
  browser!: Browser;
  url = '';
  private shared: Promise<BrowserContext> | null = null;

  private constructor(start: () => Promise<Behind> | Behind) {
    let behind: Behind | undefined;
    beforeAll(async () => {
      this.browser = await chromium.connect(inject('city').browser);
      behind = await start();
      this.url = behind.url;
    });
    afterEach(async () => {
      const kept = await this.shared;
      // A spec may end while the page still asks: nobody waits for what comes of that.
      const pages = this.browser.contexts().flatMap((one) => one.pages());
      await Promise.all(pages.map((page) => page.unrouteAll({ behavior: 'ignoreErrors' })));
      await Promise.all(this.browser.contexts().map((one) => (one === kept ? one.pages().map((page) => page.close()) : one.close())).flat());
    });
    afterAll(async () => {
      await this.browser.close();
      await behind?.stop?.();
    });
  }

  /** The dashboard that all specs share, which nothing may be done to. */
  static ofCity(): Stage {
    return new Stage(() => ({ url: inject('city').url }));
  }

  /** A dashboard of its own: the program, which can be killed. `folder` is where its files are, also its store if it has one. */
  static ofProgram(options: Options | ((folder: string) => Options | Promise<Options>), { store = true } = {}): Stage & { dashboard: Dashboard; folder: string } {
    const folder = mkdtempSync(join(tmpdir(), 'citylearn-own-'));
    const stage = new Stage(async (): Promise<Behind> => {
      own.dashboard = await startDashboard(typeof options === 'function' ? await options(folder) : options, folder, { store });
      return {
        url: own.dashboard.url,
        stop: async () => {
          await own.dashboard.program.kill();
          rmSync(folder, { recursive: true });
        },
      };
    });
    const own: Stage & { dashboard: Dashboard; folder: string } = Object.assign(stage, { dashboard: null as unknown as Dashboard, folder });
    return own;
  }

  /** Opens a page. Without options it shares its cache with others, which makes it quicker. `prepare` is called before its address is. */
  async page(hash: string, options?: BrowserContextOptions, prepare?: (page: Page) => Promise<unknown>): Promise<Opened> {
    const open = (): Promise<BrowserContext> => this.browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
    const page = await (await (options ? open() : (this.shared ??= open()))).newPage();
    await prepare?.(page);
    page.setDefaultTimeout(60_000);
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

const TOLD_AS_JSON = ['services', 'runs', 'events'];

/**
 * Stands between a page, which is not open yet, and its dashboard: the page is told `told(json)` in place of each JSON, and the
 * dashboard is asked for `asked(name)` in place of each name. Returns a function that tells the page one more message of a topic.
 */
export async function between(page: Page, told: (json: unknown) => unknown, asked = (name: string): string => name): Promise<(topic: string, json: object) => void> {
  const sockets = new Set<WebSocketRoute>();
  const names = new Map<string, string>(); // topic -> as the page calls it
  await page.route('**/api/**', async (route) => {
    const url = new URL(route.request().url());
    url.pathname = url.pathname.split('/').map((part) => encodeURIComponent(asked(decodeURIComponent(part)))).join('/');
    for (const [name, value] of [...url.searchParams]) url.searchParams.set(name, asked(value));
    const response = await route.fetch({ url: url.href });
    const json = response.ok() && response.headers()['content-type'] === 'application/json';
    await route.fulfill(json ? { json: told(await response.json()) } : { response });
  });
  await page.routeWebSocket('**/api/live', (socket) => {
    sockets.add(socket);
    const server = socket.connectToServer();
    socket.onMessage((message) => {
      const { watch } = JSON.parse(String(message)) as { watch: string[] };
      for (const topic of watch) names.set(asked(topic), topic);
      server.send(JSON.stringify({ watch: watch.map(asked) }));
    });
    server.onMessage((message) => {
      const { topic, header, payload } = parseFrame(new Uint8Array(message as Buffer).buffer);
      const json = TOLD_AS_JSON.includes(topic);
      socket.send(frameOf(
        { ...(told(header) as object), topic: names.get(topic) ?? topic },
        json ? Buffer.from(JSON.stringify(told(JSON.parse(Buffer.from(payload).toString())))) : payload,
      ));
    });
  });
  return (topic, json) => sockets.forEach((socket) => socket.send(frameOf({ topic }, Buffer.from(JSON.stringify(json)))));
}

/** Returns how far a page is wider than its window. */
export const wider = (page: Page): Promise<number> => page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);

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

/** Returns what a chart says of its lines. */
export const curve = (page: Page, name: RegExp): Promise<string> => page.getByRole('img', { name }).getAttribute('aria-label').then(String);

/** Returns the page of the address, with its parameters. */
export const hashOf = (page: Page): string => new URL(page.url()).hash.slice(2);

/** Drags over a part of the curve of the reward, from its left edge on. */
export async function zoom(page: Page, from: number, to: number): Promise<void> {
  const box = await page.locator('section[aria-label="Reward"] .u-over').boundingBox();
  if (!box) throw new Error('no plot');
  await page.mouse.move(box.x + from, box.y + 60);
  await page.mouse.down();
  await page.mouse.move(box.x + to, box.y + 60, { steps: 4 });
  await page.mouse.up();
}

/** Returns the name and the text of the file that a button saves. It is pressed by a key: it may move under a mouse while a page loads. */
export async function saved(page: Page, button: string): Promise<[name: string, text: string]> {
  const [download] = await Promise.all([page.waitForEvent('download'), page.getByRole('button', { name: button }).press('Enter')]);
  let text = '';
  for await (const part of await download.createReadStream()) text += String(part);
  return [download.suggestedFilename(), text];
}
