// SPDX-License-Identifier: Apache-2.0
import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { PicturePair, type Picture, type Shown } from '../../src/state/picture_pair';

const picture = (frame: number): Picture => ({ state: 'ready', blob: new Blob(), frame });
const sight = (frame: number): Shown['sight'] => ({ frame, seen: picture(frame) });

/** Returns the frames of the pictures that stand beside each other, "-" where one is waited for. */
const frames = (shown: Shown): string =>
  [shown.sight.seen, ...(shown.fetched ?? [null])].map((one) => (one?.state === 'ready' ? one.frame : '-')).join(' ');

describe('PicturePair', () => {
  let answers: Map<number, (pictures: Picture[] | null) => void>;
  let aborted: number[];
  let seen: string[];
  let pair: PicturePair;
  beforeEach(() => {
    vi.useFakeTimers();
    answers = new Map();
    aborted = [];
    seen = [];
    pair = new PicturePair(
      (frame, signal) => {
        signal.addEventListener('abort', () => aborted.push(frame));
        return new Promise((resolve) => answers.set(frame, resolve));
      },
      (shown) => seen.push(frames(shown)),
    );
  });
  afterEach(() => vi.useRealTimers());

  const answer = async (frame: number): Promise<void> => {
    answers.get(frame)?.([picture(frame)]);
    await vi.advanceTimersByTimeAsync(0);
  };

  it('shows pictures of one frame together, whatever the agent sees meanwhile', async () => {
    pair.take(sight(67));
    pair.take(sight(47));
    pair.take(sight(72));
    await answer(67);
    expect(seen).toEqual(['67 67']);
    await answer(72); // the newest: 47 is not asked for
    expect(seen).toEqual(['67 67', '72 72']);
    expect([...answers.keys()]).toEqual([67, 72]);
  });

  it('a picture that does not come is waited for, and the agent\'s own goes on', async () => {
    pair.take(sight(32));
    await vi.advanceTimersByTimeAsync(499);
    expect(seen).toEqual([]);
    pair.take(sight(67));
    await vi.advanceTimersByTimeAsync(1);
    expect(seen).toEqual(['67 -']);
    expect(aborted).toContain(32);
    await answer(32); // too late
    expect(seen).toEqual(['67 -']);
    await answer(67);
    expect(seen).toEqual(['67 -', '67 67']);
  });

  it('waits on for the picture of an agent that stands', async () => {
    pair.take(sight(32));
    await vi.advanceTimersByTimeAsync(5000);
    pair.take(sight(32));
    expect(seen).toEqual(['32 -', '32 -']);
    await answer(32);
    expect(seen.at(-1)).toBe('32 32');
    pair.take(sight(32));
    expect(seen.at(-1)).toBe('32 32');
    expect(answers.size).toBe(1);
  });

  it('without a connection shows what it has, and asks again for the next', async () => {
    pair.take(sight(5));
    answers.get(5)?.(null);
    await vi.advanceTimersByTimeAsync(0);
    expect(seen).toEqual(['5 -']);
    pair.take(sight(6));
    await answer(6);
    expect(seen).toEqual(['5 -', '6 6']);
  });

  it('shows nothing after its end', async () => {
    pair.take(sight(5));
    pair.stop();
    await answer(5);
    await vi.advanceTimersByTimeAsync(1000);
    expect(seen).toEqual([]);
  });
});
