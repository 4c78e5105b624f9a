// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useRef } from 'preact/hooks';
import { unauthorised } from './api/client';
import { live } from './api/live';
import { clock, plural } from './maths/format';
import { Compare } from './pages/compare';
import { Deployment } from './pages/deployment';
import { Login } from './pages/login';
import { Overview } from './pages/overview';
import { RoutePage } from './pages/route';
import { TrainingPage } from './pages/training';
import { valueOf } from './state/resource';
import { hrefOf, PAGES, place, type PageName } from './state/router';
import { about, alarmedServices, lostServices, now } from './state/shared';
import { classes, Guard, Icon, toneOf, type IconName } from './ui/basics';

const CONTENTS: Record<PageName, { title: string; Body: () => JSX.Element }> = {
  overview: { title: 'Overview', Body: Overview },
  training: { title: 'Training', Body: TrainingPage },
  route: { title: 'Route', Body: RoutePage },
  deployment: { title: 'Deployment', Body: Deployment },
  compare: { title: 'Compare', Body: Compare },
};

export function App(): JSX.Element {
  if (unauthorised.value) return <Login />;
  const { page } = place.value;
  const { title, Body } = CONTENTS[page];
  return (
    <div class="shell">
      <a class="skip" href="#main" onClick={skip}>
        Skip to the content
      </a>
      <Side page={page} />
      <div class="content">
        <Disconnected />
        <main id="main" class="stack" tabIndex={-1}>
          <PageTitle title={title} />
          <Guard key={page}>
            <Body />
          </Guard>
        </main>
      </div>
    </div>
  );
}

// The router owns the hash, so the link moves the focus itself.
function skip(event: Event): void {
  event.preventDefault();
  document.getElementById('main')?.focus();
}

function PageTitle({ title }: { title: string }): JSX.Element {
  const heading = useRef<HTMLHeadingElement>(null);
  const first = useRef(true);
  useEffect(() => {
    document.title = `${title} – CityLearn-DDS`;
    // Keyboard and screen-reader users start at the new page's title.
    if (!first.current) heading.current?.focus({ preventScroll: true });
    first.current = false;
    window.scrollTo(0, 0);
  }, [title]);
  return (
    <h1 ref={heading} tabIndex={-1}>
      {title}
    </h1>
  );
}

function Side({ page }: { page: PageName }): JSX.Element {
  const links = useRef<HTMLElement>(null);
  const server = valueOf(about.value);
  useEffect(() => {
    // On narrow screens the links are a row that scrolls.
    const link = links.current?.querySelector<HTMLElement>('[aria-current]');
    if (link && links.current) links.current.scrollLeft = link.offsetLeft - links.current.clientWidth / 2 + link.clientWidth / 2;
  }, [page]);
  return (
    <header class="row side">
      <div class="row brand">
        <img src="favicon.svg" alt="" width="28" height="28" />
        <span>
          CityLearn<span style={{ color: 'var(--text-soft)', fontWeight: 500 }}>-DDS</span>
        </span>
      </div>
      <nav aria-label="Pages" ref={links}>
        {PAGES.map((name) => (
          <a key={name} class="row" href={hrefOf(name)} aria-current={name === page ? 'page' : undefined}>
            <Icon name={name as IconName} />
            <span>{CONTENTS[name].title}</span>
            {name === 'overview' && (
              <>
                <Badge class="badge" count={lostServices.value} what="lost or failed" />
                <Badge class="alarm-badge" count={alarmedServices.value} what={alarmedServices.value === 1 ? 'alarm' : 'alarms'} />
              </>
            )}
          </a>
        ))}
      </nav>
      <div class="row between side-foot">
        <Link />
        {server && (
          <p class="fine version">
            {server.version} · {server.vendor}
          </p>
        )}
      </div>
    </header>
  );
}

function Badge({ class: name, count, what }: { class: string; count: number; what: string }): JSX.Element | null {
  if (count === 0) return null;
  return (
    <span class={name} title={`${count} ${what}`}>
      {count}
      <span class="visually-hidden"> {what}</span>
    </span>
  );
}

function Link(): JSX.Element {
  const { kind } = live.state.value;
  const lost = live.dropped.value;
  const text = kind === 'open' ? 'Live' : kind === 'connecting' ? 'Connecting' : 'Disconnected';
  return (
    <p class={classes('hint state', toneOf(kind === 'open' ? 'running' : kind === 'connecting' ? 'starting' : 'lost'))} data-link={kind} role="status">
      {text}
      {lost > 0 && (
        <span class="hint" title="This browser was too slow to show every message. What it shows is up to date.">
          {plural(lost, 'message')} skipped
        </span>
      )}
    </p>
  );
}

/** Shows how old the content is, and when the next attempt to connect is. */
function Disconnected(): JSX.Element | null {
  const state = live.state.value;
  const lostAt = live.lostAt.value;
  if (state.kind === 'open' || lostAt === null) return null;
  const wait = state.kind === 'waiting' ? Math.max(0, Math.ceil((state.until - now.value) / 1000)) : 0;
  return (
    <div class="row banner" role="alert">
      <Icon name="alert" />
      <span>
        The dashboard does not answer. The content is from {clock(lostAt / 1000)}.{' '}
        <span class="number">{wait > 0 ? `Next attempt in ${wait} s.` : 'Trying again …'}</span>
      </span>
      <button type="button" onClick={() => live.retry()}>
        Try now
      </button>
    </div>
  );
}
