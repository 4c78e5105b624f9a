// SPDX-License-Identifier: Apache-2.0
import { useEffect, useState } from 'preact/hooks';
import { ApiError, getJson, unauthorised } from '../api/client';
import { live } from '../api/live';

/** The answer to a request: loading, there, or failed. */
export type Resource<T> =
  | { state: 'loading' }
  | { state: 'ready'; value: T }
  | { state: 'failed'; error: string; status: number };

/** Returns the value that has arrived; null while there is none. */
export function valueOf<T>(resource: Resource<T>): T | null {
  return resource.state === 'ready' ? resource.value : null;
}

const LOADING = { state: 'loading' } as const; // one object, so that nothing depends on a new one

export function failure(error: unknown): { state: 'failed'; error: string; status: number } {
  return error instanceof ApiError
    ? { state: 'failed', error: error.message, status: error.status }
    : { state: 'failed', error: error instanceof Error ? error.message : String(error), status: 0 };
}

/** Repeats a request as long as the server answers that it is still fetching. */
export async function patiently<T>(ask: () => Promise<T>, abort: AbortSignal): Promise<T> {
  for (;;) {
    try {
      return await ask();
    } catch (error) {
      if (!(error instanceof ApiError) || error.retryAfter === null) throw error;
      await new Promise((resolve) => setTimeout(resolve, 1000 * (error.retryAfter ?? 1)));
      abort.throwIfAborted();
    }
  }
}

/**
 * GETs `paths`, again whenever `key` changes or the connection or the access came back. While that is under way, and when it
 * fails for want of a connection, the last answers stay.
 */
export function useJsons<T>(paths: readonly string[], key: unknown = 0): Map<string, Resource<T>> {
  const [answers, setAnswers] = useState(new Map<string, Resource<T>>());
  const [again, setAgain] = useState(0);
  useEffect(() => live.onBack(() => setAgain((n) => n + 1)), []);
  const refused = unauthorised.value;
  useEffect(() => {
    if (refused) return undefined;
    const abort = new AbortController();
    const put = (path: string, resource: Resource<T>): void => {
      if (abort.signal.aborted) return;
      setAnswers((old) => {
        const there = [...old].filter(([one]) => paths.includes(one)); // the others are not shown any more
        const keep = resource.state === 'failed' && resource.status === 0 && old.get(path)?.state === 'ready';
        return keep ? old : new Map(there).set(path, resource);
      });
    };
    for (const path of paths)
      patiently(() => getJson<T>(path, abort.signal), abort.signal)
        .then((value) => put(path, { state: 'ready', value }))
        .catch((error: unknown) => put(path, failure(error)));
    return () => abort.abort();
  }, [paths.join('\n'), key, again, refused]);
  return new Map(paths.map((path) => [path, answers.get(path) ?? LOADING]));
}

/** Likewise for one path, or none (null). */
export function useJson<T>(path: string | null, key: unknown = 0): Resource<T> {
  const answers = useJsons<T>(path === null ? [] : [path], key);
  return answers.get(path ?? '') ?? LOADING;
}
