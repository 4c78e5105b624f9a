// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import type { Run } from '../api/types';
import { momentName, momentText } from '../maths/moment';
import { curveAxis, cursorAt, cursorParams, setCursor, type Seen } from '../state/cursor';
import { hrefOf, place, type PageName } from '../state/router';

const LINKS: Partial<Record<PageName, string>> = { training: 'Curves', route: 'Route', deployment: 'Replay' };

/** Says at which moment of a run the page is, and leads to the same moment on other pages. Shows nothing without a cursor. */
export function MomentBar({ run, seen, clear }: { run: Run; seen: Seen; clear: string }): JSX.Element | null {
  const at = cursorAt();
  if (at === null) return null;
  const links = (Object.entries(LINKS) as [PageName, string][]).filter(([page]) => page !== place.value.page);
  return (
    <div class="wrap card moment" role="group" aria-label="Moment">
      <p>
        <b>At {momentName(curveAxis(), at)}</b> <span class="hint">{seen.moment ? momentText(seen.moment) : seen.pending ? '' : 'This run has no updates.'}</span>
      </p>
      <nav class="row" aria-label="The same moment on other pages">
        {links.map(([page, text]) => (
          <a key={page} href={hrefOf(page, { [page === 'training' ? 'runs' : 'run']: run.id, ...cursorParams() })}>
            {text}
          </a>
        ))}
        <button type="button" onClick={() => setCursor(null)}>
          {clear}
        </button>
      </nav>
    </div>
  );
}
