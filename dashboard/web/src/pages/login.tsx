// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useState } from 'preact/hooks';
import { logIn } from '../api/client';
import { failure } from '../state/resource';
import { Failed } from '../ui/basics';

/** Asks for the token. It is sent in a header and kept in memory only. */
export function Login(): JSX.Element {
  const [token, setToken] = useState('');
  const [error, setError] = useState<string | null>(null);
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    setBusy(true);
    setError(null);
    try {
      await logIn(token.trim());
    } catch (cause) {
      const failed = failure(cause);
      setError(failed.status === 401 ? 'The token is wrong.' : failed.error);
    }
    setBusy(false);
  };
  return (
    <main class="login">
      <form class="card stack" onSubmit={(event) => void submit(event)}>
        <img src="favicon.svg" alt="" width="40" height="40" />
        <h1>CityLearn-DDS</h1>
        <p>
          This dashboard requires its token, which is in the file that its option <code>--token-file</code> names. The link that
          the dashboard printed when it started needs no token.
        </p>
        <label class="field hint">
          <span>Token</span>
          <input
            type="password"
            autocomplete="off"
            spellcheck={false}
            required
            value={token}
            onInput={(event) => setToken(event.currentTarget.value)}
          />
        </label>
        {error && <Failed error={error} />}
        <button type="submit" class="primary" disabled={busy}>
          {busy ? 'Checking …' : 'Open'}
        </button>
      </form>
    </main>
  );
}
