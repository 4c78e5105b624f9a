// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import type { Run } from '../api/types';
import { dateTime } from '../maths/format';
import { isKnown, preferredRun, runName } from '../maths/runs';
import { param, setParams, usePinned } from '../state/router';
import { Select } from './basics';

/** Returns the run that the address names, else the one that preferredRun() does. */
export function chosenRun(runs: readonly Run[], state: Run['state']): Run {
  const wanted = param('run', '');
  return runs.find((run) => run.id === wanted) ?? preferredRun(runs, state);
}

export function RunSelect({ runs, chosen }: { runs: readonly Run[]; chosen: Run }): JSX.Element {
  usePinned('run', isKnown(chosen) ? chosen.id : null);
  return (
    <Select
      label="Run"
      value={chosen.id}
      options={runs.map((run) => ({
        value: run.id,
        label: `${runName(run)} · ${run.state === 'running' ? 'running' : dateTime(run.started)}`,
      }))}
      onChange={(id) => setParams({ run: id, env: null, agent: null, episode: null, step: null, evaluation: null })}
    />
  );
}
