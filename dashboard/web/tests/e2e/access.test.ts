// SPDX-License-Identifier: Apache-2.0
import { once } from 'node:events';
import { readFileSync } from 'node:fs';
import { createServer, type Server } from 'node:http';
import type { AddressInfo } from 'node:net';
import { join } from 'node:path';
import type { Page } from 'playwright-core';
import { afterAll, beforeAll, describe, expect, inject, it } from 'vitest';
import { Stage, violations } from './stage';

// A dashboard with a token that sees the city's services, and a foreign server on another port.

describe('a dashboard with a token', () => {
  const stage = Stage.ofProgram((folder) => ({ ...inject('city').wire, id: 'guarded', leave: true, 'token-file': join(folder, 'token') }));
  let foreign: Server;
  let port = 0; // of the foreign server

  beforeAll(async () => {
    foreign = createServer((_, response) => {
      response.writeHead(200, { 'Content-Type': 'text/html', 'Access-Control-Allow-Origin': '*' }).end('<!doctype html><title>foreign</title>');
    }).listen(0, '127.0.0.1');
    await once(foreign, 'listening');
    port = (foreign.address() as AddressInfo).port;
  });
  afterAll(() => void foreign.close());

  const token = (): string => readFileSync(join(stage.folder, 'token'), 'utf8').trim();
  const live = (page: Page): Promise<void> => page.locator('[data-link="open"]').waitFor();

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
    const context = await stage.browser.newContext();
    const page = await context.newPage();
    page.setDefaultTimeout(60_000);
    await page.goto(stage.url);
    await page.getByLabel('Token').fill(token());
    await page.getByRole('button', { name: 'Open' }).click();
    await live(page);
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
});
