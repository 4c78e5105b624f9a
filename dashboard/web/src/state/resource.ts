// SPDX-License-Identifier: Apache-2.0
import { useEffect, useState } from 'preact/hooks';
import { ApiError, getJson, unauthorised } from '../api/client';
import { live } from '../api/live';

/** Something asked of the server: on its way, there, or refused. */
export type Resource<T> =
  | { state: 'loading' }
  | { state: 'ready'; value: T }
  | { state: 'failed'; error: string; status: number };

export function failure(error: unknown): { state: 'failed'; error: string; status: number } {
  return error instanceof ApiError
    ? { state: 'failed', error: error.message, status: error.status }
    : { state: 'failed', error: error instanceof Error ? error.message : String(error), status: 0 };
}

/** GETs, as often as the server says that it is still fetching. */
async function getPatiently<T>(path: string, abort: AbortSignal): Promise<T> {
  for (;;) {
    try {
      return await getJson<T>(path, abort);
    } catch (error) {
      if (!(error instanceof ApiError) || error.retryAfter === null) throw error;
      await new Promise((resolve) => setTimeout(resolve, 1000 * (error.retryAfter ?? 1)));
      abort.throwIfAborted();
    }
  }
}

/**
 * GETs `path` (null: nothing to ask), again whenever `key` changes or the connection or the access came back. While that is
 * under way, and when it fails for want of a connection, the last answer of the same path stays.
 */
export function useJson<T>(path: string | null, key: unknown = 0): Resource<T> {
  const [answer, setAnswer] = useState<{ path: string | null; resource: Resource<T> }>({ path, resource: { state: 'loading' } });
  const [again, setAgain] = useState(0);
  useEffect(() => live.onBack(() => setAgain((n) => n + 1)), []);
  const refused = unauthorised.value;
  useEffect(() => {
    if (path === null || refused) return undefined;
    const abort = new AbortController();
    getPatiently<T>(path, abort.signal)
      .then((value) => setAnswer({ path, resource: { state: 'ready', value } }))
      .catch((error: unknown) => {
        if (abort.signal.aborted) return;
        const failed = failure(error);
        setAnswer((old) =>
          failed.status === 0 && old.path === path && old.resource.state === 'ready' ? old : { path, resource: failed },
        );
      });
    return () => abort.abort();
  }, [path, key, again, refused]);
  return answer.path === path ? answer.resource : { state: 'loading' };
}

/** Likewise for several paths at once. */
export function useJsons<T>(paths: readonly string[]): Map<string, Resource<T>> {
  const [answers, setAnswers] = useState(new Map<string, Resource<T>>());
  const [again, setAgain] = useState(0);
  useEffect(() => live.onBack(() => setAgain((n) => n + 1)), []);
  useEffect(() => {
    const abort = new AbortController();
    const put = (path: string, resource: Resource<T>): void => {
      if (!abort.signal.aborted) setAnswers((old) => new Map(old).set(path, resource));
    };
    for (const path of paths)
      getPatiently<T>(path, abort.signal)
        .then((value) => put(path, { state: 'ready', value }))
        .catch((error: unknown) => put(path, failure(error)));
    return () => abort.abort();
  }, [paths.join('\n'), again]);
  return new Map(paths.map((path) => [path, answers.get(path) ?? { state: 'loading' }]));
}
