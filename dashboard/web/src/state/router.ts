// SPDX-License-Identifier: Apache-2.0
import { signal } from '@preact/signals';
import { useEffect } from 'preact/hooks';

export const PAGES = ['overview', 'training', 'route', 'deployment', 'compare'] as const;
export type PageName = (typeof PAGES)[number];

export interface Place {
  page: PageName;
  params: URLSearchParams;
}

/** Parses "#/training?x=steps". An unknown page is the overview. */
function placeOf(hash: string): Place {
  const [path = '', query = ''] = hash.replace(/^#\/?/, '').split('?', 2);
  const page = PAGES.find((name) => name === path) ?? 'overview';
  return { page, params: new URLSearchParams(query) };
}

export function hrefOf(page: PageName, params: Record<string, string> | URLSearchParams = {}): string {
  const query = new URLSearchParams(params).toString();
  return `#/${page}${query ? `?${query}` : ''}`;
}

export const place = signal<Place>(placeOf(location.hash));

let writing: ReturnType<typeof setTimeout> | undefined;

window.addEventListener('hashchange', () => {
  clearTimeout(writing);
  place.value = placeOf(location.hash);
});

// A slider changes more often than browsers allow the address to change.
function write(hash: string): void {
  clearTimeout(writing);
  writing = setTimeout(() => {
    if (placeOf(location.hash).page === placeOf(hash).page) history.replaceState(null, '', hash);
  }, 150);
}

/** Changes parameters of the page without a new history entry. Null removes a parameter. */
export function setParams(changes: Record<string, string | null>): void {
  const { page, params } = place.value;
  const next = new URLSearchParams(params);
  for (const [key, value] of Object.entries(changes)) {
    if (value === null) next.delete(key);
    else next.set(key, value);
  }
  write(hrefOf(page, next));
  place.value = { page, params: next };
}

export function param(name: string, otherwise: string): string {
  return place.value.params.get(name) ?? otherwise;
}

/**
 * Writes into the address what the page chose itself, so that the address shows the same when another choice would be newer.
 * Nothing is written for null (a run that a better one will take the place of), or where `named` says that the address names
 * it in another way.
 */
export function usePinned(name: string, value: string | null, named = false): void {
  const pinned = named || place.value.params.has(name);
  useEffect(() => {
    if (!pinned && value !== null) setParams({ [name]: value });
  }, [pinned, name, value]);
}
