// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useState } from 'preact/hooks';
import { dateTime, fixed, plural } from '../maths/format';
import type { Group } from '../maths/groups';
import { setParams } from '../state/router';
import { Card, State, Swatch, Tick } from './basics';
import { Choice, GROUPS } from './choice';

interface RunPickerProps {
  groups: readonly Group[];
  /** Keys of the groups that are drawn. */
  shown: ReadonlySet<string>;
  /** IDs of the runs whose own lines are hidden. */
  hidden: ReadonlySet<string>;
  /** Run ID -> colour. */
  colours: ReadonlyMap<string, string>;
  /** Number of chosen groups that are not drawn, as they would be too many. */
  omitted: number;
}

const MAX_GROUPS = 100; // in the list: a thousand take a browser seconds

/** Chooses which groups of seeds are drawn, and which seeds have a line of their own. */
export function RunPicker({ groups, shown, hidden, colours, omitted }: RunPickerProps): JSX.Element {
  const [filter, setFilter] = useState('');
  const matching = groups.filter((group) =>
    `${group.label} ${group.runs.map((run) => run.id).join(' ')}`.toLowerCase().includes(filter.toLowerCase()),
  );
  const listed = matching.filter((group, i) => i < MAX_GROUPS || shown.has(group.key));
  const toggleGroup = (key: string): void => {
    const next = new Set(shown);
    if (!next.delete(key)) next.add(key);
    setParams({ groups: groups.filter((group) => next.has(group.key)).map((group) => group.key).join('\n'), runs: null });
  };
  const toggleRun = (id: string): void => {
    const next = new Set(hidden);
    if (!next.delete(id)) next.add(id);
    setParams({ hide: next.size ? [...next].join('\n') : null });
  };
  return (
    <Card title="Runs" class="picker" hint="Means include every seed of a group, shown or hidden.">
      <Choice of={GROUPS} />
      {groups.length > 5 && (
        <label class="field hint">
          <span>Find</span>
          <input type="search" value={filter} onInput={(event) => setFilter(event.currentTarget.value)} />
        </label>
      )}
      {omitted > 0 && <p class="hint">{plural(omitted, 'further group')} not drawn: too many curves at once.</p>}
      {listed.length < matching.length && <p class="hint">{plural(matching.length - listed.length, 'further group')}: find them by their names.</p>}
      <ul class="picker-list scrolls" tabIndex={0} aria-label="Groups of runs">
        {listed.map((group) => {
          const on = shown.has(group.key);
          return (
            <li key={group.key}>
              <Tick checked={on} onChange={() => toggleGroup(group.key)}>
                <span class="stack">
                  <b>{group.label}</b>
                  <span class="hint">
                    {plural(group.runs.length, 'seed')} · {dateTime(group.runs[0]?.started)}
                  </span>
                </span>
              </Tick>
              {on && (
                <ul>
                  {group.runs.map((run) => (
                    <li key={run.id}>
                      <Tick checked={!hidden.has(run.id)} onChange={() => toggleRun(run.id)}>
                        <Swatch colour={colours.get(run.id) ?? 'text-soft'} />
                        <span>seed {run.seed ?? '?'}</span>
                        {run.state !== 'ended' && <State state={run.state} />}
                        <span class="number">{fixed(run.spl, 3)}</span>
                      </Tick>
                    </li>
                  ))}
                </ul>
              )}
            </li>
          );
        })}
      </ul>
    </Card>
  );
}
