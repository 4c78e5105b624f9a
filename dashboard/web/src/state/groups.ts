// SPDX-License-Identifier: Apache-2.0
import { useMemo } from 'preact/hooks';
import { runPath } from '../api/client';
import type { Run, RunDetail } from '../api/types';
import { groupRuns, namesakes, settingsOf, type Group, type GroupBy } from '../maths/groups';
import { useJsons, valueOf } from './resource';

/** Returns the runs as groups of seeds. Until the manifests have arrived, runs of one name are a group. */
export function useGroups(all: readonly Run[], by: GroupBy): Group[] {
  const shared = namesakes(all, by).map((run) => run.id);
  const answers = useJsons<RunDetail>(shared.map((id) => runPath(id)));
  const states = [...answers.values()].map((one) => one.state).join();
  return useMemo(() => {
    const settings = new Map<string, string>();
    if (!states.includes('loading'))
      for (const id of shared) {
        const answer = answers.get(runPath(id));
        const manifest = answer && valueOf(answer)?.manifest;
        if (manifest) settings.set(id, settingsOf(manifest));
      }
    return groupRuns(all, by, settings);
  }, [all, by, shared.join('\n'), states]);
}
