// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import type { Run } from '../api/types';
import { dateTime } from '../maths/format';
import { runName } from '../maths/runs';
import { param, setParams, usePinned } from '../state/router';
import { Select } from './basics';

/** Returns the run that the address names, else the first that `prefer` accepts, else the newest. `runs` must not be empty. */
export function chosenRun(runs: readonly Run[], prefer: (run: Run) => boolean): Run {
  const wanted = param('run', '');
  return runs.find((run) => run.id === wanted) ?? runs.find(prefer) ?? (runs[0] as Run);
}

export function RunSelect({ runs, chosen }: { runs: readonly Run[]; chosen: Run }): JSX.Element {
  usePinned('run', chosen.id);
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
