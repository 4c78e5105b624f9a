// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useState } from 'preact/hooks';
import { timecode } from '../maths/format';
import { beyond } from '../state/cursor';
import { changePlayback, marks, playback, playbackError, seekPlayback, togglePlayback } from '../state/playback';
import { Failed, IconButton, Select } from './basics';

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16, 'max'] as const;
const JUMP = 5; // seconds, of an arrow key

/** What takes keys itself. */
const TAKES_KEYS = 'input, select, textarea, button, a, summary, [tabindex="0"]';

/** Space and arrows steer the recording, wherever the focus is, unless that element takes them. */
function onKey(event: KeyboardEvent): void {
  const now = playback.value;
  if (!now || event.altKey || event.ctrlKey || event.metaKey || event.shiftKey) return;
  if (event.target instanceof Element && event.target.closest(TAKES_KEYS) && !event.target.matches('.playback input')) return;
  if (event.key === ' ') togglePlayback();
  else if (event.key === 'ArrowRight') seekPlayback(now.position + JUMP);
  else if (event.key === 'ArrowLeft') seekPlayback(now.position - JUMP);
  else return;
  event.preventDefault();
}

/** Pauses the open recording and goes to any position of it. Shows nothing while none is open. */
export function PlaybackBar(): JSX.Element | null {
  const now = playback.value;
  const [dragged, setDragged] = useState<number | null>(null);
  useEffect(() => {
    window.addEventListener('keydown', onKey);
    return () => window.removeEventListener('keydown', onKey);
  }, []);
  if (!now) return null;
  const position = dragged ?? now.position;
  const length = Math.max(now.length ?? 0, position);
  const speeds = SPEEDS.some((one) => one === now.speed) ? SPEEDS : [now.speed, ...SPEEDS];
  return (
    <section class="playback" aria-label="Recording">
      {playbackError.value && <Failed error={playbackError.value} />}
      {beyond.value && (
        <p class="note" role="status">
          {beyond.value}
        </p>
      )}
      <div class="row transport">
        <IconButton
          icon={now.paused || now.ended ? 'play' : 'pause'}
          label={now.ended ? 'Play again' : now.paused ? 'Resume' : 'Pause'}
          onClick={togglePlayback}
        />
        <div class="timeline">
          <Marks />
          <input
            type="range"
            aria-label="Position"
            min={0}
            max={length || 1}
            step={0.1}
            value={position}
            disabled={now.length === null}
            aria-valuetext={`${timecode(position)} of ${timecode(now.length)}`}
            onInput={(event) => setDragged(Number(event.currentTarget.value))}
            onChange={(event) => {
              seekPlayback(Number(event.currentTarget.value));
              setDragged(null);
            }}
          />
        </div>
        <output aria-live="off">
          {timecode(position)} / {timecode(now.length)}
          {now.seeking && <span class="fine"> going there</span>}
        </output>
        <Select
          label="Speed"
          value={String(now.speed)}
          options={speeds.map((one) => ({ value: String(one), label: one === 'max' ? 'as fast as it can' : `${one} ×` }))}
          onChange={(value) => void changePlayback({ speed: value === 'max' ? value : Number(value) })}
        />
      </div>
      <p class="fine keys">Space pauses and resumes, arrows go {JUMP} s back and on.</p>
    </section>
  );
}

/** How many episodes (upwards) and updates (downwards) each part of the recording has, as square roots: few are seen too. */
function Marks(): JSX.Element | null {
  const shown = marks.value;
  if (!shown) return null;
  const bars = (counts: readonly number[], of: string, sign: 1 | -1): JSX.Element[] => {
    const most = Math.max(1, ...counts);
    return counts.flatMap((count, i) => {
      const height = count > 0 ? 1 + 7 * Math.sqrt(count / most) : 0;
      return height ? [<rect key={`${of}${i}`} class={of} x={i} y={sign > 0 ? 8 - height : 8} width={0.7} height={height} />] : [];
    });
  };
  return (
    <svg viewBox={`0 0 ${shown.episodes.length} 16`} preserveAspectRatio="none" role="img" aria-label="Episodes above, updates below, in each part of the recording">
      {bars(shown.episodes, 'episodes', 1)}
      {bars(shown.updates, 'updates', -1)}
    </svg>
  );
}
