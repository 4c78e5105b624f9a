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
      setError(failed.status === 401 ? 'That is not the token.' : failed.error);
    }
    setBusy(false);
  };
  return (
    <main class="login">
      <form class="card stack" onSubmit={(event) => void submit(event)}>
        <img src="favicon.svg" alt="" width="40" height="40" />
        <h1>CityLearn-DDS</h1>
        <p>
          This dashboard asks for its token. It stands in the file that <code>--token-file</code> names; the link that the
          dashboard printed when it started needs none.
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
          {busy ? 'Asking …' : 'Open'}
        </button>
      </form>
    </main>
  );
}
