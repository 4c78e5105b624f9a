// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { runPath } from '../api/client';
import type { Evaluation, Run, Service } from '../api/types';
import { curveOf } from '../maths/curves';
import { bytes, clock, dateTime, duration, fixed, integer, plural, short } from '../maths/format';
import { meanRate } from '../maths/runs';
import { latest, type Rows } from '../maths/rows';
import { known } from '../maths/seeds';
import { useJson, valueOf } from '../state/resource';
import { hrefOf } from '../state/router';
import { about, alarmedServices, events, lostServices, now, runs, services, type SeenServices } from '../state/shared';
import { useTraining } from '../state/training';
import { Card, Empty, Show, State, toneOf } from '../ui/basics';
import { Spark } from '../ui/spark';
import { figure, SaveTable, TableCard, text, type Column } from '../ui/table';
import { SplTable } from './deployment';

export function Overview(): JSX.Element {
  const all = valueOf(runs.value) ?? [];
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
                  <div class="tiles tight run-cards">
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
          {running.length === 0 && all[0] && <Result run={all[0]} />}
          <Services />
        </div>
        <Events />
      </div>
    </>
  );
}

function NothingRuns({ known }: { known: readonly Run[] }): JSX.Element {
  if (known.length) return <Empty title="No training in progress">The newest run and what came of it are below.</Empty>;
  return (
    <Empty title="No runs yet">
      Start one with <code>citylearn demo</code>, or start services of your own on this domain: they appear here automatically.
    </Empty>
  );
}

/** What came of a run that has ended. */
function Result({ run }: { run: Run }): JSX.Element {
  const evaluations = valueOf(useJson<{ evaluations: Evaluation[] }>(runPath(run.id, '/evaluations'), run.state));
  const rows = useTraining([run.id]).get(run.id)?.rows;
  return (
    <>
      <Card title="Newest run" hint={dateTime(run.started)}>
        <RunCard run={run} rows={rows} />
      </Card>
      {evaluations && evaluations.evaluations.length > 0 && <SplTable list={evaluations.evaluations} />}
    </>
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
  const there = known(values);
  return there.length ? there.reduce((a, b) => a + b, 0) : null;
}

function Totals({ running, rows }: { running: readonly Run[]; rows: readonly (Rows | undefined)[] }): JSX.Element {
  const list = valueOf(services.value)?.services ?? [];
  const up = list.filter((service) => !['lost', 'stopped', 'failed'].includes(service.state)).length;
  const gone = lostServices.value;
  const alarms = alarmedServices.value;
  const notes = [gone && `${gone} lost or failed`, alarms && plural(alarms, 'alarm')].filter(Boolean).join(', ');
  const lessons = known(rows.map((one) => one && latest(one, 'lesson')));
  const store = valueOf(about.value)?.store;
  const figures: [name: string, value: string, note?: string | false | undefined][] = [
    ['Steps per second', short(sum(running.map((run) => run.steps_per_second)))],
    ['Episodes per second', short(sum(rows.map(rateOf)))],
    [
      'Lesson',
      [...new Set(lessons)].map(integer).join(', ') || '–',
      lessons.length > 0 && lessons.every((lesson) => lesson === 0) && 'first lesson or no curriculum',
    ],
    ['Services up', integer(up), notes],
    ['Episodes recorded', short(store && Math.max(store.episodes, 0)), store && bytes(store.bytes)],
  ];
  return (
    <dl class="card figures">
      {figures.map(([name, value, note]) => (
        <div key={name}>
          <dt class="hint">{name}</dt>
          <dd>
            <b>{value}</b>
            {note && <span class="fine">{note}</span>}
          </dd>
        </div>
      ))}
    </dl>
  );
}

function RunCard({ run, rows }: { run: Run; rows: Rows | undefined }): JSX.Element {
  const pairs = [
    ['SPL', fixed(run.spl, 3)],
    ['Reward', fixed(run.reward, 3)],
    ['Steps', short(run.steps)],
    ['Episodes', short(run.episodes)],
    ['Steps/s', short(run.state === 'running' ? run.steps_per_second : meanRate(run))],
    ['Lesson', integer(rows && latest(rows, 'lesson'))],
    ['Policy lag', fixed(rows && latest(rows, 'policy_lag'), 1)],
    ['Time', duration(run.wall)],
  ] as const;
  return (
    <article class="run-card">
      <header class="row between">
        <h3>
          <a href={hrefOf('training', { runs: run.id })}>{run.agent || 'unknown agent'}</a>
        </h3>
        <State state={run.state} />
      </header>
      <p class="hint">
        {[run.learner, run.seed !== null && `seed ${run.seed}`, `session ${run.session}`].filter(Boolean).join(' · ')}
      </p>
      {rows && rows.length > 1 && (
        <Spark curve={curveOf(rows, { metric: 'spl', x: 'steps', smoothing: 0.9 })} low={0} high={1} />
      )}
      <dl class="pairs">
        {pairs.map(([name, value]) => (
          <div key={name}>
            <dt class="fine">{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      <nav class="row" aria-label={`${run.agent ?? ''} ${run.id}`}>
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
  const there = valueOf(services.value);
  const columns: Column<Service>[] = [
    { ...text('id', 'Service'), key: 'service' },
    { ...text('service', 'Kind'), key: 'kind' },
    { ...text('state', 'State'), show: (s) => <State state={s.state} /> },
    { ...text('activity', 'Activity'), wide: true },
    { ...text('alarm', 'Alarm'), wide: true, show: (s) => (s.alarm ? <b class="alarm tone-bad">{s.alarm}</b> : '–') },
    figure('rate', 'Steps/s', (rate: number | null) => short(rate || null)),
    {
      key: 'heartbeat_age',
      label: 'Heartbeat',
      number: true,
      show: (s) => heartbeat(there && ageOf(s, there)),
      cell: (s) => s.age,
    },
    text('host', 'Host'),
    { ...text('process', 'Process'), number: true },
    text('middleware', 'DDS'),
    {
      key: 'incarnation',
      label: 'Incarnation',
      number: true,
      show: (s) => <span title={String(s.incarnation)}>{String(s.incarnation).slice(-6)}</span>,
      cell: (s) => String(s.incarnation),
    },
    figure('uptime', 'Up', duration),
    figure('processors', 'Processors', (value: number | null) => fixed(value, 2)),
    figure('memory', 'Memory', bytes),
    figure('sent_bytes', 'Bytes sent', bytes),
    figure('received_bytes', 'Bytes received', bytes),
    figure('received', 'Received', short),
    figure('resent', 'Resent', short),
    figure('repeated', 'Repeated', short),
    figure('rejected', 'Rejected', short),
    figure('foreign', 'Other sessions', short),
    text('session', 'Session'),
  ];
  const list = [...(there?.services ?? [])].sort(
    (a, b) => ORDER.indexOf(a.state) - ORDER.indexOf(b.state) || a.id.localeCompare(b.id) || a.session.localeCompare(b.session),
  );
  const domain = valueOf(about.value)?.domain;
  return (
    <TableCard
      title="Services"
      name="services"
      hint={list.length ? plural(list.length, 'service') : undefined}
      of={services.value}
      columns={columns}
      rows={list}
      rowKey={(s) => `${s.session}/${s.id}`}
      rowClass={(s) => (s.alarm || s.state === 'lost' || s.state === 'failed' ? 'bad' : s.state === 'stopped' ? 'past' : undefined)}
      empty={
        <Empty title="No services found">
          Services announce themselves once a second. If some are running, compare their <code>--domain</code> with the dashboard's
          {domain !== undefined && ` (${domain})`}.
        </Empty>
      }
    />
  );
}

function Events(): JSX.Element {
  const list = valueOf(events.value) ?? [];
  const columns = (['time', 'kind', 'session', 'service', 'text'] as const).map((key) => text(key, key));
  return (
    <Card title="Events" actions={<SaveTable name="events" columns={columns} rows={list} />}>
      <Show of={events.value} lines={6}>
        {() =>
          list.length ? (
            <ol class="events scrolls" tabIndex={0} aria-label="Events, newest first">
              {list.slice(0, 100).map((event) => (
                <li key={`${event.time} ${event.service} ${event.kind}`} class={`event event-${event.kind}`}>
                  <time class="hint" dateTime={new Date(event.time * 1000).toISOString()} title={dateTime(event.time)}>
                    {clock(event.time)}
                  </time>
                  <b class={toneOf(event.kind)}>{event.kind}</b>
                  <span>
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
