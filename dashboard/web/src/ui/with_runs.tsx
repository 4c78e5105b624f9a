// SPDX-License-Identifier: Apache-2.0
import type { ComponentChildren, JSX } from 'preact';
import type { Run } from '../api/types';
import { runs } from '../state/shared';
import { Card, Empty, Show } from './basics';

/** Shows what a page makes of the runs, or that there are none yet and what will appear here. */
export function WithRuns({ title, empty, children }: {
  title: string;
  empty: ComponentChildren;
  children: (all: readonly Run[]) => JSX.Element;
}): JSX.Element {
  return (
    <Show of={runs.value}>
      {(all) =>
        all.length ? (
          children(all)
        ) : (
          <Card title={title}>
            <Empty title="No runs yet">{empty}</Empty>
          </Card>
        )
      }
    </Show>
  );
}
