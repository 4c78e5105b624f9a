// SPDX-License-Identifier: Apache-2.0
import { beforeAll, describe, expect, it } from 'vitest';
import type { Page } from 'playwright-core';
import type { Episode, Run } from '../../src/api/types';
import { api, between, eventually, saved, Stage, wider } from './stage';

// Services and files may say anything. On each page, every text of theirs must stay a text.

const HACK = 'window.hacked=1';
const MARKS: [what: string, mark: string][] = [
  ['an element', `<img src=x onerror=${HACK}>`],
  ['the end of what is around it', `"'\`--></script></style></title></select></svg><script>${HACK}</script>`],
  ['attributes', `" onmouseover="${HACK}" autofocus onfocus='${HACK}' style='position:fixed;inset:0' x="`],
  ['an SVG', `<svg/onload=${HACK}><use href="data:image/svg+xml,<svg id='x' xmlns='http://www.w3.org/2000/svg'/>#x">`],
  ['what is decoded once more', `&lt;img src=x&gt;&#60;img&#62;%3Cimg%20src=x%3E\\u003cimg\\x3e\${${HACK}}{{${HACK}}}`],
  ['right-to-left marks', '\u202e\u2067\u200f'],
  ['no end', 'W'.repeat(64)],
];

/** What matters only where a text begins. Behind each stand some of the others. */
const BEGINNINGS: [what: string, mark: string][] = [
  ['a link', `javascript:${HACK}//`],
  ['a part of an address', '//evil.example/../?a=b&c#d%2F..'],
  ['a formula', '=HYPERLINK(1+1)'],
];
const TEXTS = BEGINNINGS.map(([what, mark], i): [string, string] => {
  const others = MARKS.filter((_, at) => at % BEGINNINGS.length === i);
  return [[what, ...others.map(([other]) => other)].join(', '), mark + others.map(([, other]) => other).join('')];
});

const stage = Stage.ofCity();

// A run that has ended, and one of its episodes.
let run = '';
let rowid = 0;
beforeAll(async () => {
  run = (await api<{ runs: Run[] }>(stage.url, 'runs')).runs.find(({ policy, state }) => policy === 'policy' && state === 'ended')?.id ?? '';
  rowid = (await api<{ episodes: Episode[] }>(stage.url, `runs/${encodeURIComponent(run)}/episodes?limit=1`)).episodes[0]?.rowid ?? 0;
});

/** Texts of the dashboard itself, by their keys, and one that the page looks for. All others come from services and files. */
const OWN = ['columns', 'hash', 'incarnation', 'kind', 'mode', 'state', 'type'];
const CONTROL = 'sequence_filter';
/** What has no text in the city. */
const TEXTLESS = { alarm: 'checkpoint: No space left on device' };

/** Returns a JSON of the dashboard with the mark before each text of services and files, also in names of options. */
function marked(json: unknown, mark: string, key = ''): unknown {
  if (OWN.includes(key) || json === CONTROL) return json;
  if (typeof json === 'string') return mark + json;
  if (Array.isArray(json)) return json.map((one) => marked(one, mark, key));
  if (json === null || typeof json !== 'object') return json;
  const before = key === 'parameters' ? mark : '';
  return Object.fromEntries(Object.entries(json).map(([name, one]) => [before + name, marked(name in TEXTLESS ? TEXTLESS[name as 'alarm'] : one, mark, name)]));
}

/** Each page, and where a text from elsewhere stands on it: in an element or in one of its attributes. */
const VIEWS: [page: string, hash: (mark: string) => string, places: string[]][] = [
  ['overview', () => 'overview', ['.run-card h3', '.run-card .hint', '.run-card nav', 'tbody th', 'td:nth-child(2)', 'td:nth-child(4)', '.alarm', 'td:nth-child(8)', 'td:nth-child(10)', 'td:last-child', '.event b + span', '.version']],
  ['training', (mark) => `training?runs=${encodeURIComponent(mark + run)}`, ['.picker-list b', '[role=img]', '.tooltip span', '.legend li']],
  ['route', () => 'route', ['h2', '.card-head .hint', 'option', '.map', '.picture figcaption', '.picture img']],
  ['deployment', (mark) => `deployment?run=${encodeURIComponent(mark + run)}&episode=${rowid}`, ['h2', 'option', '.player .map', '.card-head .hint', 'thead + tbody th', '#episodes td', '.legend li', '[role=img]']],
  ['compare', () => 'compare', ['.path', 'tbody th', 'tbody td', 'thead th']],
];

/** Returns the places where no text has the mark. */
const missing = (page: Page, places: string[], mark: string): Promise<string[]> =>
  page.evaluate(
    ([selectors, text]) =>
      selectors.filter((selector) => ![...document.querySelectorAll(selector)].some((one) => [one.textContent, ...[...one.attributes].map(({ value }) => value)].some((said) => said?.includes(text)))),
    [places, mark] as const,
  );

/** Returns the elements that the page does not make, and the attributes and links that it does not set. */
const strange = (page: Page): Promise<string[]> =>
  page.evaluate(() => {
    const elements = [...document.querySelectorAll('script:not(head > [src^="./assets/"]), iframe, object, embed, base, meta[http-equiv], form, body style, body link, foreignObject, use, image, img:not([src^="blob:"], [src="favicon.svg"], .matrix)')];
    const attributes = [...document.querySelectorAll('*')].filter((one) => [...one.attributes].some(({ name }) => /^on|^(srcdoc|autofocus|action|formaction|target)$/.test(name)));
    const links = [...document.querySelectorAll<HTMLAnchorElement>('a[href]')].filter((one) => !one.href.startsWith(document.baseURI.replace(/#.*/, '')));
    return [...elements, ...attributes, ...links].map((one) => one.outerHTML.slice(0, 200));
  });

const hacked = (page: Page): Promise<unknown> => page.evaluate(() => (window as unknown as { hacked?: unknown }).hacked ?? ({} as { hacked?: unknown }).hacked);

describe.each(TEXTS)('names and texts of %s', (_, mark) => {
  it('stay texts, everywhere', async () => {
    const { page, complaints, outside } = await stage.page('overview', { acceptDownloads: true }, (one) => between(one, (json) => marked(json, mark), (name) => name.replaceAll(mark, '')));
    for (const [name, hash, places] of VIEWS) {
      await page.goto(`${stage.url}#/${hash(mark)}`);
      const plot = page.locator('.u-over').first();
      if (name === 'training') await plot.hover();
      await eventually(() => missing(page, places, mark), (none) => none.length === 0);
      expect(await strange(page), name).toEqual([]);
      expect(await wider(page), name).toBeLessThanOrEqual(0);
      await expect.poll(() => page.title()).toMatch(/^[\w ]+ – CityLearn-DDS$/);
    }
    for (const title of ['groups', 'manifests']) {
      const [name, text] = await saved(page, `Download ${title} as CSV`);
      expect(name).toBe(`${title}.csv`);
      expect(text).toContain(mark.replaceAll('"', '""'));
      expect(text).not.toMatch(/(^|,)"?=/m);
    }
    expect(await hacked(page)).toBeUndefined();
    expect(complaints).toEqual([]);
    expect(outside).toEqual([]);
  });
});

describe('what else the page is given', () => {
  const mark = `<img src=x onerror=${HACK}>`;

  it.each([mark, `javascript:${HACK}`, '-1', '1e999'])('in its address is looked up, never shown: %s', async (value) => {
    const names = ['runs', 'groups', 'hide', 'x', 'by', 'show', 'smooth', 'run', 'env', 'agent', 'sibling', 'view', 'episode', 'evaluation', 'kind', 'order', 'goal', 'limit', 'result', 'row', 'matrix', 'metric', 'keys', 'tag', 'from', 'to', 'step', 'speed'];
    const query = names.map((one) => `${one}=${encodeURIComponent(value)}`).join('&');
    const { page, complaints, outside } = await stage.page(`${encodeURIComponent(value)}?${query}`);
    for (const [name] of VIEWS) {
      await page.goto(`${stage.url}#/${name}?${query}`);
      await page.waitForFunction(() => document.querySelector('main .card') && !document.querySelector('.loading'));
      expect([await strange(page), await hacked(page), outside], name).toEqual([[], undefined, []]);
    }
    expect(complaints.filter((one) => !/status of 40\d/.test(one))).toEqual([]);
  });

  it('as an error stands where the answer would, as it is; elements written as JSON make none', async () => {
    const { page } = await stage.page('overview');
    const element = { type: 'img', props: { src: 'x', onerror: HACK }, constructor: null, key: null, ref: null, __k: null, __: null, __b: 0, __e: null, __c: null, __v: 1, __i: -1, __u: 0 };
    const event = { time: 1, session: 's', service: 's', kind: 'run', text: mark };
    await page.route('**/api/events*', (route) => route.fulfill({ json: { events: [{ ...event, service: element, text: element }, event] } }));
    await page.route('**/evaluations', (route) => route.fulfill({ status: 500, json: { error: mark } }));
    await page.reload();
    await page.locator('.event', { hasText: mark }).waitFor();
    expect(await strange(page)).toEqual([]);
    await page.goto(`${stage.url}#/deployment`);
    await page.locator('.failed', { hasText: mark }).waitFor();
    await page.locator('#episodes tbody tr').first().waitFor(); // the rest of the page is there
    expect([await strange(page), await hacked(page)]).toEqual([[], undefined]);
  });

  it.each([4_294_967_295, 500_000_000])('as a count of frames costs nothing: %i', async (frames) => {
    const { page, complaints } = await stage.page('overview');
    await page.route('**/api/map/*', (route) => route.fulfill({ status: 404, json: { error: 'no map' } }));
    await page.route('**/api/episodes/*', async (route) => {
      const response = await route.fetch();
      await route.fulfill({ json: { ...((await response.json()) as object), goal: frames } });
    });
    await page.goto(`${stage.url}#/deployment?run=${encodeURIComponent(run)}&episode=${rowid}`);
    await page.locator('.player .map .walker').waitFor();
    expect(complaints.filter((one) => !/status of 404/.test(one))).toEqual([]);
  });
});
