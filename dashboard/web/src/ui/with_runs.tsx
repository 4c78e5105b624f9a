// SPDX-License-Identifier: Apache-2.0
import type { ComponentChildren, JSX } from 'preact';
import type { Run } from '../api/types';
import { isLogged } from '../maths/logged';
import { runs } from '../state/shared';
import { Card, Empty, Show } from './basics';

/** Shows what a page makes of the runs, or that there are none yet and what will appear here. */
export function WithRuns({ title, empty, trained = false, children }: {
  title: string;
  /** Without those that programs log: they have no routes and episodes. */
  trained?: boolean;
  empty: ComponentChildren;
  children: (all: readonly Run[]) => JSX.Element;
}): JSX.Element {
  return (
    <Show of={runs.value}>
      {(known) => {
        const all = trained ? known.filter((run) => !isLogged(run)) : known;
        return all.length ? (
          children(all)
        ) : (
          <Card title={title}>
            <Empty title="No runs yet">{empty}</Empty>
          </Card>
        );
      }}
    </Show>
  );
}
