// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useState } from 'preact/hooks';
import { patchJson, runPath } from '../api/client';
import type { Run } from '../api/types';
import { tagsOf } from '../maths/runs';
import { failure } from '../state/resource';
import { replaceRun } from '../state/shared';
import { Failed, IconButton } from './basics';

/** The tags and the note of a run, which can be changed. `name` tells the run from others. */
export function RunNotes({ run, name }: { run: Run; name: string }): JSX.Element {
  const [editing, setEditing] = useState(false);
  if (editing) return <Editor run={run} done={() => setEditing(false)} />;
  return (
    <div class="wrap notes">
      {run.tags.map((tag) => (
        <span key={tag} class="tag">
          {tag}
        </span>
      ))}
      {run.note && <span class="hint run-note">{run.note}</span>}
      <IconButton icon="edit" label={`Tags and note of ${name}`} onClick={() => setEditing(true)} />
    </div>
  );
}

function Editor({ run, done }: { run: Run; done: () => void }): JSX.Element {
  const [tags, setTags] = useState(run.tags.join(', '));
  const [note, setNote] = useState(run.note);
  const [error, setError] = useState('');
  const save = (): void => {
    patchJson<Run>(runPath(run.id), { tags: tagsOf(tags), note })
      .then((saved) => {
        replaceRun(saved);
        done();
      })
      .catch((cause: unknown) => setError(failure(cause).error));
  };
  return (
    <div class="stack tight notes-editor" onKeyDown={(event) => event.key === 'Escape' && done()}>
      <label class="field hint">
        <span>Tags, with commas between them</span>
        <input type="text" class="framed" value={tags} onInput={(event) => setTags(event.currentTarget.value)} onKeyDown={(event) => event.key === 'Enter' && save()} />
      </label>
      <label class="field hint">
        <span>Note</span>
        <textarea class="framed" rows={3} value={note} onInput={(event) => setNote(event.currentTarget.value)} />
      </label>
      {error && <Failed error={error} />}
      <span class="row">
        <button type="button" onClick={save}>
          Save
        </button>
        <button type="button" onClick={done}>
          Cancel
        </button>
      </span>
    </div>
  );
}
