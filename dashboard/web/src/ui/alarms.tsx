// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useState } from 'preact/hooks';
import type { AlarmRule, AlarmsAnswer, RunAlarm, When } from '../api/alarms';
import { patchJson, postJson, remove } from '../api/client';
import { TRAINING_FIGURES } from '../api/training_figures';
import { FIGURE_OF, ruleOf, type Raised, type RuleForm } from '../maths/alarms';
import { clock, dateTime, plural } from '../maths/format';
import { alarms, loadAlarms, raised } from '../state/alarms';
import { failure, valueOf } from '../state/resource';
import { hrefOf } from '../state/router';
import { runs } from '../state/shared';
import { Card, Failed, Icon, IconButton, Select, Show } from './basics';

const WHENS: { value: When; label: string }[] = [
  { value: 'below', label: 'A figure is below' },
  { value: 'above', label: 'A figure is above' },
  { value: 'not_finite', label: 'A figure is not finite' },
  { value: 'silent', label: 'No new point comes' },
  { value: 'lost', label: 'The run is lost' },
];
const PAST = 5;

/** The alarms of services and runs, and the rules for runs. */
export function Alarms(): JSX.Element {
  const [making, setMaking] = useState(false);
  const [error, setError] = useState('');
  const attempt = (change: Promise<unknown>): void => {
    change
      .then(() => setError(''))
      .catch((cause: unknown) => setError(failure(cause).error))
      .finally(loadAlarms);
  };
  return (
    <Card
      title="Alarms"
      actions={
        making || (
          <button type="button" onClick={() => setMaking(true)}>
            New rule
          </button>
        )
      }
    >
      {making && <RuleEditor done={() => setMaking(false)} />}
      {error && <Failed error={error} />}
      <Show of={alarms.value}>
        {({ rules, alarms: all }: AlarmsAnswer) => {
          const past = all.filter((one) => one.over !== null).slice(0, PAST);
          return (
            <>
              {raised.value.length > 0 && (
                <ol class="events" aria-label="Alarms that last">
                  {raised.value.map((one) => (
                    <Lasting key={one.key} alarm={one} dismiss={(id) => attempt(patchJson(`api/alarms/${id}`, { over: true }))} />
                  ))}
                </ol>
              )}
              {past.length > 0 && (
                <ol class="events" aria-label="Alarms that are over">
                  {past.map((one) => (
                    <Past key={one.id} alarm={one} />
                  ))}
                </ol>
              )}
              {rules.length > 0 && (
                <ul class="alarm-rules" aria-label="Rules">
                  {rules.map((rule) => (
                    <Rule key={rule.id} rule={rule} drop={() => attempt(remove(`api/alarms/${rule.id}`))} />
                  ))}
                </ul>
              )}
              {raised.value.length + past.length + rules.length === 0 && !making && (
                <p class="hint">No alarms. A rule raises one when a run needs somebody: a figure is below a value, no new points come, or it is lost.</p>
              )}
            </>
          );
        }}
      </Show>
    </Card>
  );
}

/** The alarms of a run that last, if there are any. */
export function RunAlarms({ run }: { run: string }): JSX.Element {
  return (
    <>
      {raised.value
        .filter((one) => one.run === run)
        .map((one) => (
          <p key={one.key} class="row hint tone-bad">
            <Icon name="alert" /> {one.text}
          </p>
        ))}
    </>
  );
}

/** How many alarms last, for the link to where they are. */
export function AlarmBadge(): JSX.Element | null {
  const count = raised.value.length;
  if (count === 0) return null;
  return (
    <span class="alarm-badge" title={plural(count, 'alarm')}>
      {count}
      <span class="visually-hidden">{count === 1 ? ' alarm' : ' alarms'}</span>
    </span>
  );
}

function Lasting({ alarm, dismiss }: { alarm: Raised; dismiss: (id: number) => void }): JSX.Element {
  const { run, service, text, since, id } = alarm;
  return (
    <li class="alarm-line">
      {since !== null ? <Time at={since} /> : <span class="hint">now</span>}
      <span>
        {run !== undefined ? <a href={hrefOf('training', { runs: run })}>{run}</a> : <b>{service}</b>} <span class="tone-bad">{text}</span>
      </span>
      {id !== undefined && (
        <button type="button" aria-label={`Dismiss the alarm of ${run ?? ''}: ${text}`} onClick={() => dismiss(id)}>
          Dismiss
        </button>
      )}
    </li>
  );
}

function Past({ alarm }: { alarm: RunAlarm }): JSX.Element {
  return (
    <li class="alarm-line hint">
      <Time at={alarm.since} />
      <span>
        <a href={hrefOf('training', { runs: alarm.run })}>{alarm.run}</a> {alarm.text} (over since {clock(alarm.over)})
      </span>
    </li>
  );
}

function Time({ at }: { at: number }): JSX.Element {
  return (
    <time class="hint" dateTime={new Date(at * 1000).toISOString()} title={dateTime(at)}>
      {clock(at)}
    </time>
  );
}

function Rule({ rule, drop }: { rule: AlarmRule; drop: () => void }): JSX.Element {
  return (
    <li class="row between">
      <span>
        {rule.text} <span class="tag">{rule.runs === '*' ? 'all runs' : rule.runs}</span>
      </span>
      <IconButton icon="trash" label={`Remove the rule: ${rule.text}, ${rule.runs}`} onClick={drop} />
    </li>
  );
}

function RuleEditor({ done }: { done: () => void }): JSX.Element {
  const [form, setForm] = useState<RuleForm>({ when: 'below', runs: '*', figure: '', value: '', points: '1', minutes: '30' });
  const [error, setError] = useState('');
  const change = (part: Partial<RuleForm>): void => setForm((old) => ({ ...old, ...part }));
  const save = async (): Promise<void> => {
    try {
      await postJson('api/alarms', ruleOf(form));
      loadAlarms();
      done();
    } catch (cause) {
      setError(failure(cause).error);
    }
  };
  const known = (valueOf(runs.value) ?? []).slice(0, 50);
  const names = ['*', ...new Set(known.flatMap((run) => [run.id, `${run.id.split('/')[0] ?? ''}/*`, ...run.tags]))];
  const field = (name: keyof RuleForm, label: string, list?: string): JSX.Element => (
    <label class="field hint">
      <span>{label}</span>
      <input type="text" class="framed" list={list} value={form[name]} onInput={(event) => change({ [name]: event.currentTarget.value })} />
    </label>
  );
  const figure = FIGURE_OF[form.when];
  return (
    <form
      class="stack tight notes-editor alarm-form"
      aria-label="New rule"
      onSubmit={(event) => {
        event.preventDefault();
        void save();
      }}
      onKeyDown={(event) => event.key === 'Escape' && done()}
    >
      <Select label="Alarm when" value={form.when} options={WHENS} onChange={(when: When) => change({ when })} />
      {figure !== 'none' && field('figure', figure === 'possible' ? 'Figure (empty: any)' : 'Figure', 'alarm-figures')}
      {(form.when === 'below' || form.when === 'above') && field('value', 'Value')}
      {figure === 'needed' && field('points', 'For so many points')}
      {form.when === 'silent' && field('minutes', 'For so many minutes')}
      {field('runs', 'Runs: an ID, a pattern with *, or a tag', 'alarm-runs')}
      <datalist id="alarm-figures">
        {TRAINING_FIGURES.map((one) => (
          <option key={one.name} value={one.name} />
        ))}
      </datalist>
      <datalist id="alarm-runs">
        {names.map((name) => (
          <option key={name} value={name} />
        ))}
      </datalist>
      {error && <Failed error={error} />}
      <span class="row">
        <button type="submit">Save</button>
        <button type="button" onClick={done}>
          Cancel
        </button>
      </span>
    </form>
  );
}
