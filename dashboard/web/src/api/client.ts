// SPDX-License-Identifier: Apache-2.0
import { signal } from '@preact/signals';

/** An error that the server answered. */
export class ApiError extends Error {
  constructor(
    readonly status: number,
    message: string,
    /** Seconds after which to try again, if the server sent them. */
    readonly retryAfter: number | null = null,
  ) {
    super(message);
  }
}

/** Whether the server requires a token that it has not received. */
export const unauthorised = signal(false);

// Kept in memory only: a reload asks again, unless there is the cookie of /login.
let token: string | null = null;

/** Fetches `path`. Throws ApiError unless the server answers with success. */
export async function request(path: string, init: RequestInit = {}): Promise<Response> {
  let response: Response;
  try {
    const headers = token === null ? {} : { Authorization: `Bearer ${token}` };
    response = await fetch(path, { ...init, headers, credentials: 'same-origin' });
  } catch (error) {
    if (error instanceof DOMException && error.name === 'AbortError') throw error;
    throw new ApiError(0, 'The dashboard does not answer.');
  }
  if (response.ok) return response;
  if (response.status === 401) unauthorised.value = true;
  let what = `${response.status} ${response.statusText}`;
  try {
    const body = (await response.json()) as { error?: string };
    if (body.error) what = body.error;
  } catch {
    // A proxy answered: only its status is known.
  }
  const retry = Number(response.headers.get('Retry-After'));
  throw new ApiError(response.status, what, response.status === 503 && retry > 0 ? retry : null);
}

export async function getJson<T>(path: string, abort?: AbortSignal): Promise<T> {
  const response = await request(path, abort ? { signal: abort } : {});
  return (await response.json()) as T;
}

/** Returns whether the server answers within 5 s. */
export async function alive(): Promise<boolean> {
  try {
    return (await fetch('healthz', { signal: AbortSignal.timeout(5000) })).ok;
  } catch {
    return false;
  }
}

/** Returns the path of a run's resource. The ID is one percent-encoded segment. */
export function runPath(id: string, rest = ''): string {
  return `api/runs/${encodeURIComponent(id)}${rest}`;
}

/**
 * Tries a token. The server answers with the cookie that WebSocket and pictures need, as neither can carry a header.
 * Throws ApiError when the token is wrong.
 */
export async function logIn(given: string): Promise<void> {
  token = given;
  try {
    await request('login');
    unauthorised.value = false;
  } catch (error) {
    token = null;
    throw error;
  }
}
