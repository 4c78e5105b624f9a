// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import type { Run, Service, ServiceEvent } from '../api/types';
import { curveOf } from '../maths/curves';
import { bytes, clock, dateTime, duration, fixed, integer, plural, short } from '../maths/format';
import { latest, type Rows } from '../maths/rows';
import { hrefOf } from '../state/router';
import { about, events, now, runs, services, type SeenServices } from '../state/shared';
import { useTraining } from '../state/training';
import { Card, Empty, Figure, Show, State } from '../ui/basics';
import { Spark } from '../ui/spark';
import { SaveTable, Table, type Column } from '../ui/table';

export function Overview(): JSX.Element {
  const all = runs.value.state === 'ready' ? runs.value.value : [];
  const running = all.filter((run) => run.state === 'running');
  // The rates of actors and learners are in their training. More than a dozen runs at once are not followed.
  const training = useTraining(running.slice(0, 12).map((run) => run.id));
  const rows = running.map((run) => training.get(run.id)?.rows);
  return (
    <>
      <Totals running={running} rows={rows} />
      <div class="columns overview-columns">
        <div class="stack">
          <Card title="Running">
            <Show of={runs.value}>
              {() =>
                running.length ? (
                  <div class="run-cards">
                    {running.map((run, i) => (
                      <RunCard key={run.id} run={run} rows={rows[i]} />
                    ))}
                  </div>
                ) : (
                  <NothingRuns known={all} />
                )
              }
            </Show>
          </Card>
          <Services />
        </div>
        <Events />
      </div>
    </>
  );
}

function NothingRuns({ known }: { known: readonly Run[] }): JSX.Element {
  const newest = known[0];
  if (newest)
    return (
      <Empty title="No training in progress">
        See the newest run, {newest.agent} of {dateTime(newest.started)}, under{' '}
        <a href={hrefOf('training')}>Training</a>.
      </Empty>
    );
  return (
    <Empty title="No runs yet">
      Start one with <code>./run demo</code>, or start services of your own on this domain: they appear here automatically.
    </Empty>
  );
}

function rateOf(rows: Rows | undefined): number | null {
  if (!rows || rows.length < 2) return null;
  // Over the last updates that took at least two seconds together.
  const { wall, episodes } = rows.columns;
  const end = rows.length - 1;
  let from = end - 1;
  while (from > 0 && (wall[end] ?? 0) - (wall[from] ?? 0) < 2) --from;
  const seconds = (wall[end] ?? 0) - (wall[from] ?? 0);
  return seconds > 0 ? ((episodes[end] ?? 0) - (episodes[from] ?? 0)) / seconds : null;
}

function sum(values: readonly (number | null | undefined)[]): number | null {
  const known = values.filter((value): value is number => typeof value === 'number' && Number.isFinite(value));
  return known.length ? known.reduce((a, b) => a + b, 0) : null;
}

function Totals({ running, rows }: { running: readonly Run[]; rows: readonly (Rows | undefined)[] }): JSX.Element {
  const list = services.value.state === 'ready' ? services.value.value.services : [];
  const up = list.filter((service) => !['lost', 'stopped', 'failed'].includes(service.state)).length;
  const gone = list.filter((service) => service.state === 'lost' || service.state === 'failed').length;
  const alarms = list.filter((service) => service.alarm).length;
  const notes = [gone && `${gone} lost or failed`, alarms && plural(alarms, 'alarm')].filter(Boolean).join(', ');
  const lessons = rows.map((one) => (one ? latest(one, 'lesson') : null)).filter((lesson) => lesson !== null);
  const store = about.value.state === 'ready' ? about.value.value.store : null;
  return (
    <dl class="figures">
      <Figure label="Steps per second" value={running.length ? short(sum(running.map((run) => run.steps_per_second))) : '–'} />
      <Figure label="Episodes per second" value={short(sum(rows.map(rateOf)))} />
      <Figure
        label="Lesson"
        value={lessons.length ? [...new Set(lessons)].map(integer).join(', ') : '–'}
        note={lessons.length && lessons.every((lesson) => lesson === 0) ? 'first lesson or no curriculum' : undefined}
      />
      <Figure label="Services up" value={integer(up)} note={notes || undefined} />
      <Figure
        label="Episodes recorded"
        value={store ? short(Math.max(store.episodes, 0)) : '–'}
        note={store ? bytes(store.bytes) : undefined}
      />
    </dl>
  );
}

function RunCard({ run, rows }: { run: Run; rows: Rows | undefined }): JSX.Element {
  const pairs = [
    ['SPL', fixed(run.spl, 3)],
    ['Reward', fixed(run.reward, 3)],
    ['Steps', short(run.steps)],
    ['Episodes', short(run.episodes)],
    ['Steps/s', short(run.steps_per_second)],
    ['Lesson', integer(rows && latest(rows, 'lesson'))],
    ['Policy lag', fixed(rows && latest(rows, 'policy_lag'), 1)],
    ['Time', duration(run.wall)],
  ] as const;
  return (
    <article class="run-card">
      <header>
        <h3>
          <a href={hrefOf('training', { runs: run.id })}>{run.agent || 'unknown agent'}</a>
        </h3>
        <State state={run.state} />
      </header>
      <p class="hint">
        {[run.learner, run.seed !== null && `seed ${run.seed}`, run.session].filter(Boolean).join(' · ')}
      </p>
      {rows && rows.length > 1 && (
        <Spark curve={curveOf(rows, { metric: 'spl', x: 'steps', smoothing: 0.9 })} low={0} high={1} />
      )}
      <dl class="pairs">
        {pairs.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      <nav class="run-links" aria-label={`${run.agent} ${run.id}`}>
        <a href={hrefOf('training', { runs: run.id })}>Training</a>
        <a href={hrefOf('route', { run: run.id })}>Route</a>
        <a href={hrefOf('deployment', { run: run.id })}>Deployment</a>
      </nav>
    </article>
  );
}

/** Returns the seconds since the last heartbeat: the age that the server sent plus the time since then. */
function ageOf(service: Service, all: SeenServices): number | null {
  if (service.age === null) return null;
  return service.age + Math.max(0, now.value - all.seen) / 1000;
}

function heartbeat(seconds: number | null): string {
  if (seconds === null) return '–';
  return seconds < 60 ? `${seconds.toFixed(0)} s ago` : `${duration(seconds)} ago`;
}

const ORDER = ['lost', 'failed', 'starting', 'waiting', 'running', 'stopping', 'stopped'];

function Services(): JSX.Element {
  const there = services.value.state === 'ready' ? services.value.value : null;
  const columns: Column<Service>[] = [
    { key: 'service', label: 'Service', show: (s) => <span class="name">{s.id}</span>, cell: (s) => s.id },
    { key: 'kind', label: 'Kind', show: (s) => s.service, cell: (s) => s.service },
    { key: 'state', label: 'State', show: (s) => <State state={s.state} />, cell: (s) => s.state },
    { key: 'activity', label: 'Activity', wide: true, show: (s) => s.activity, cell: (s) => s.activity },
    {
      key: 'alarm',
      label: 'Alarm',
      wide: true,
      show: (s) => (s.alarm ? <span class="alarm">{s.alarm}</span> : '–'),
      cell: (s) => s.alarm,
    },
    { key: 'rate', label: 'Steps/s', number: true, show: (s) => (s.rate ? short(s.rate) : '–'), cell: (s) => s.rate },
    {
      key: 'heartbeat_age',
      label: 'Heartbeat',
      number: true,
      show: (s) => (there ? heartbeat(ageOf(s, there)) : '–'),
      cell: (s) => s.age,
    },
    { key: 'host', label: 'Host', show: (s) => s.host, cell: (s) => s.host },
    { key: 'process', label: 'Process', number: true, show: (s) => s.process, cell: (s) => s.process },
    { key: 'middleware', label: 'DDS', show: (s) => s.middleware, cell: (s) => s.middleware },
    {
      key: 'incarnation',
      label: 'Incarnation',
      number: true,
      show: (s) => <span title={String(s.incarnation)}>{String(s.incarnation).slice(-6)}</span>,
      cell: (s) => String(s.incarnation),
    },
    { key: 'uptime', label: 'Up', number: true, show: (s) => duration(s.uptime), cell: (s) => s.uptime },
    { key: 'received', label: 'Received', number: true, show: (s) => short(s.received), cell: (s) => s.received },
    { key: 'resent', label: 'Resent', number: true, show: (s) => short(s.resent), cell: (s) => s.resent },
    { key: 'repeated', label: 'Repeated', number: true, show: (s) => short(s.repeated), cell: (s) => s.repeated },
    { key: 'rejected', label: 'Rejected', number: true, show: (s) => short(s.rejected), cell: (s) => s.rejected },
    { key: 'foreign', label: 'Foreign', number: true, show: (s) => short(s.foreign), cell: (s) => s.foreign },
    { key: 'session', label: 'Session', show: (s) => s.session, cell: (s) => s.session },
  ];
  const list = there
    ? [...there.services].sort(
        (a, b) => ORDER.indexOf(a.state) - ORDER.indexOf(b.state) || a.id.localeCompare(b.id) || a.session.localeCompare(b.session),
      )
    : [];
  return (
    <Card
      title="Services"
      hint={there && list.length ? plural(list.length, 'service') : undefined}
      actions={<SaveTable name="services" columns={columns} rows={list} />}
    >
      <Show of={services.value} lines={5}>
        {() =>
          list.length ? (
            <Table
              caption="Services"
              columns={columns}
              rows={list}
              rowKey={(s) => `${s.session}/${s.id}`}
              rowClass={(s) => (s.alarm || s.state === 'lost' || s.state === 'failed' ? 'bad' : s.state === 'stopped' ? 'past' : undefined)}
            />
          ) : (
            <Empty title="No services found">
              Services announce themselves once a second. If some are running, compare their <code>--domain</code> with the dashboard's
              {about.value.state === 'ready' && ` (${about.value.value.domain})`}.
            </Empty>
          )
        }
      </Show>
    </Card>
  );
}

function Events(): JSX.Element {
  const list = events.value.state === 'ready' ? events.value.value : [];
  const columns: Column<ServiceEvent>[] = [
    { key: 'time', label: 'Time', show: (e) => clock(e.time), cell: (e) => e.time },
    { key: 'kind', label: 'Kind', show: (e) => e.kind, cell: (e) => e.kind },
    { key: 'session', label: 'Session', show: (e) => e.session, cell: (e) => e.session },
    { key: 'service', label: 'Service', show: (e) => e.service, cell: (e) => e.service },
    { key: 'text', label: 'Text', show: (e) => e.text, cell: (e) => e.text },
  ];
  return (
    <Card title="Events" class="events-card" actions={<SaveTable name="events" columns={columns} rows={list} />}>
      <Show of={events.value} lines={6}>
        {() =>
          list.length ? (
            <ol class="events" tabIndex={0} aria-label="Events, newest first">
              {list.slice(0, 100).map((event) => (
                <li key={`${event.time} ${event.service} ${event.kind}`} class={`event event-${event.kind}`}>
                  <time dateTime={new Date(event.time * 1000).toISOString()} title={dateTime(event.time)}>
                    {clock(event.time)}
                  </time>
                  <span class="event-kind">{event.kind}</span>
                  <span class="event-text">
                    {event.service && <b>{event.service}</b>} {event.text}
                  </span>
                </li>
              ))}
            </ol>
          ) : (
            <Empty title="No events yet" />
          )
        }
      </Show>
    </Card>
  );
}
