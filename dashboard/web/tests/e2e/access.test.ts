// SPDX-License-Identifier: Apache-2.0
import { once } from 'node:events';
import { readFileSync } from 'node:fs';
import { createServer, type Server } from 'node:http';
import type { AddressInfo } from 'node:net';
import { join } from 'node:path';
import type { BrowserContext, Page } from 'playwright-core';
import { afterAll, beforeAll, describe, expect, inject, it } from 'vitest';
import { Stage, violations } from './stage';

// A dashboard with a token that sees the city's services, and a foreign server on another port.

describe('a dashboard with a token', () => {
  const stage = Stage.ofProgram((folder) => ({ ...inject('city').wire, id: 'guarded', leave: true, 'token-file': join(folder, 'token') }));
  let foreign: Server;
  let port = 0; // of the foreign server
  const asked: string[] = []; // of it

  beforeAll(async () => {
    foreign = createServer((request, response) => {
      if (request.url !== '/') asked.push(`${request.method} ${request.url}`);
      response.writeHead(200, { 'Content-Type': 'text/html', 'Access-Control-Allow-Origin': '*' }).end('<!doctype html><title>foreign</title>');
    }).listen(0, '127.0.0.1');
    await once(foreign, 'listening');
    port = (foreign.address() as AddressInfo).port;
  });
  afterAll(() => void foreign.close());

  const token = (): string => readFileSync(join(stage.folder, 'token'), 'utf8').trim();
  const live = (page: Page): Promise<void> => page.locator('[data-link="open"]').waitFor();

  /** Returns a context that has logged in. */
  async function known(): Promise<{ context: BrowserContext; page: Page }> {
    const context = await stage.browser.newContext();
    const page = await context.newPage();
    page.setDefaultTimeout(60_000);
    await page.goto(stage.url);
    await page.getByLabel('Token').fill(token());
    await page.getByRole('button', { name: 'Open' }).click();
    await live(page);
    return { context, page };
  }

  it('is opened by its link once, which leaves nothing behind but the cookie', async () => {
    const context = await stage.browser.newContext();
    const page = await context.newPage();
    await page.goto(stage.dashboard.link);
    await live(page);
    expect(page.url()).toBe(stage.url);
    const left = await page.evaluate(() => [document.cookie, document.referrer, localStorage.length, sessionStorage.length, history.length]);
    expect(left).toEqual(['', '', 0, 0, 2]); // about:blank and the page
    const [cookie, ...more] = await context.cookies();
    expect(more).toEqual([]);
    expect(cookie).toMatchObject({ httpOnly: true, sameSite: 'Strict', path: '/', domain: '127.0.0.1', expires: -1 });
    expect([token(), stage.dashboard.link]).not.toContain(cookie?.value);
    const second = await context.newPage(); // another tab
    await second.goto(stage.url);
    await live(second);
    const stranger = await (await stage.browser.newContext()).newPage();
    expect((await stranger.goto(stage.dashboard.link))?.status()).toBe(401);
    expect(await stranger.context().cookies()).toEqual([]);
  });

  it('asks for the token, and then shows runs and pictures', async () => {
    const { page, outside } = await stage.page('overview', {});
    const requests: string[] = [];
    page.on('request', (request) => requests.push(request.url()));
    const field = page.getByLabel('Token');
    await field.fill(token().replace(/^./, (c) => (c === '0' ? '1' : '0')));
    expect(await violations(page)).toEqual([]);
    await page.getByRole('button', { name: 'Open' }).click();
    await page.getByText('The token is wrong.').waitFor();
    expect(await page.context().cookies()).toEqual([]);
    await field.fill(token());
    await page.getByRole('button', { name: 'Open' }).click();
    await live(page);
    await page.waitForSelector('.run-card');
    // The cookie opens the next page, and the pictures.
    await page.goto(`${stage.url}#/route`);
    await page.reload();
    await page.waitForSelector('.picture img');
    expect(requests.some((one) => one.includes(token()))).toBe(false);
    expect(outside).toEqual([]);
  });

  // Another port of its own host is the same site: the browser sends the cookie along. Another name is another site.
  it.each(['127.0.0.1', 'localhost'])('cannot be used by a page of %s on another port', async (host) => {
    const { context, page } = await known();
    await page.goto(`http://${host}:${port}/`);
    const reached = await page.evaluate(async (target) => {
      const element = (tag: string, what: object): Promise<boolean> =>
        new Promise((done) => document.head.append(Object.assign(document.createElement(tag), { onload: () => done(true), onerror: () => done(false) }, what)));
      const asks = (path: string, init: RequestInit): Promise<boolean> => fetch(target + path, { credentials: 'include', ...init }).then(() => true, () => false);
      const socket = new Promise<boolean>((done) => {
        const one = new WebSocket(`${target.replace('http', 'ws')}api/live`);
        one.onopen = () => done(true);
        one.onerror = () => done(false);
      });
      return Object.entries({
        fetch: await asks('api/runs', {}),
        opaque: await asks('api/runs', { mode: 'no-cors' }),
        metrics: await asks('metrics', { mode: 'no-cors' }),
        remove: await asks('api/runs/a', { method: 'DELETE' }),
        post: await asks('api/runs', { method: 'POST', mode: 'no-cors', body: 'a=b' }),
        login: await asks('login', { mode: 'no-cors' }),
        script: await element('script', { src: `${target}api/runs` }),
        picture: await element('img', { src: `${target}favicon.svg` }),
        style: await element('link', { rel: 'stylesheet', href: `${target}api/runs` }),
        socket: await socket,
      }).flatMap(([name, yes]) => (yes ? [name] : []));
    }, stage.url);
    expect(reached).toEqual([]);
    const framed = (target: string): void => document.body.append(Object.assign(document.createElement('iframe'), { src: target }));
    await Promise.all([page.waitForEvent('console', (message) => message.text().includes('frame-ancestors')), page.evaluate(framed, stage.url)]);
    const [opened] = await Promise.all([context.waitForEvent('page'), page.evaluate((target) => void window.open(target), stage.url)]);
    await live(opened);
    expect(await opened.evaluate(() => window.opener === null)).toBe(true);
  });

  it('has a page in which nothing foreign runs, and from which nothing is sent elsewhere', async () => {
    const { page } = await known();
    asked.length = 0;
    const elsewhere = `http://127.0.0.1:${port}/`;
    const refused = await page.evaluate(async (to) => {
      const seen = new Map<string, number>();
      document.addEventListener('securitypolicyviolation', ({ effectiveDirective: name }) => seen.set(name, (seen.get(name) ?? 0) + 1));
      const hack = 'window.hacked=1';
      const add = <K extends keyof HTMLElementTagNameMap>(tag: K, what: Partial<HTMLElementTagNameMap[K]>): HTMLElementTagNameMap[K] => {
        const one = Object.assign(document.createElement(tag), what);
        document.body.append(one);
        return one;
      };
      const quiet = (act: () => unknown): void => {
        try {
          act();
        } catch {
          // Refused at once.
        }
      };
      document.body.insertAdjacentHTML('beforeend', `<img src="data:image/gif;base64,R0lGODlhAQABAAAAACw=" onload="${hack}" onerror="${hack}"><svg onload="${hack}"></svg><p style="position:fixed"></p><style>p{color:red}</style>`);
      add('script', { textContent: hack });
      add('script', { src: `${to}script` });
      add('script', { src: `data:text/javascript,${hack}` });
      add('script', { src: 'api/about' }); // of its own origin, but no script
      add('iframe', { srcdoc: `<script>parent.${hack}</script>` });
      add('iframe', { src: `${to}frame` });
      add('object', { data: `${to}object` });
      add('img', { src: `${to}picture` });
      add('link', { rel: 'stylesheet', href: `${to}style` });
      add('base', { href: to });
      add('a', { href: `javascript:${hack}` }).click();
      add('form', { action: `${to}form`, method: 'post' }).submit();
      fetch(`${to}fetch`).catch(() => undefined);
      quiet(() => new WebSocket(to.replace('http', 'ws')));
      quiet(() => new EventSource(`${to}events`));
      quiet(() => navigator.sendBeacon(`${to}beacon`, document.title));
      quiet(() => new Worker(URL.createObjectURL(new Blob([`fetch('${to}worker')`], { type: 'text/javascript' }))));
      // eslint-disable-next-line @typescript-eslint/no-implied-eval -- this is an attack
      quiet(() => setTimeout(hack));
      const wanted: Record<string, number> = { 'base-uri': 1, 'connect-src': 4, 'form-action': 1, 'frame-src': 1, 'img-src': 1, 'object-src': 1, 'script-src-attr': 2, 'script-src-elem': 4, 'style-src-attr': 1, 'style-src-elem': 2, 'worker-src': 1, 'script-src': 1 };
      const end = Date.now() + 60_000;
      const lacking = (): string[] => Object.entries(wanted).flatMap(([name, count]) => ((seen.get(name) ?? 0) < count ? [`${name} ${seen.get(name) ?? 0}`] : []));
      while (lacking().length && Date.now() < end) await new Promise((done) => requestAnimationFrame(done));
      return [lacking(), (window as unknown as { hacked?: number }).hacked ?? null, document.baseURI];
    }, elsewhere);
    expect(refused).toEqual([[], null, stage.url]);
    expect(asked).toEqual([]);
  });
});
