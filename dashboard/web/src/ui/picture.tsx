// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { ApiError, request } from '../api/client';
import { live } from '../api/live';
import type { RunTraversal } from '../api/types';
import { sameTraversal, type Recorded } from '../maths/scene';
import { PicturePair, type Picture, type Shown, type Sight } from '../state/picture_pair';
import { patiently } from '../state/resource';
import { param, setParams } from '../state/router';
import { Select } from './basics';
import { useVisible } from './use';

const WAITING: Picture = { state: 'waiting' };

/** Fetches the picture of a frame, or says why there is none. Returns null without a connection: the banner reports that. */
async function fetchFrame(hash: string, frame: number, signal: AbortSignal): Promise<Picture | null> {
  try {
    const response = await patiently(() => request(`api/frames/${hash}/${frame}?nearest=1`, { signal }), signal);
    // Of a long route the dashboard stores pictures of some places only.
    return { state: 'ready', blob: await response.blob(), frame: Number(response.headers.get('X-Frame') ?? frame) };
  } catch (error) {
    if (!(error instanceof ApiError) || error.status === 0) return null;
    const gone = error.status === 404;
    return { state: 'none', text: gone ? 'No picture of this place is stored, and no env_service has it now.' : `The picture could not be loaded (${error.status}).` };
  }
}

/** Returns the sight that is shown, with the pictures of its frame on the traversals with these hashes. */
function usePair(hashes: readonly string[], sight: Sight | null, visible: boolean): Shown | null {
  const [shown, setShown] = useState<Shown | null>(null);
  const key = hashes.join();
  const pair = useMemo(
    () =>
      new PicturePair(async (frame, signal) => {
        const fetched = await Promise.all(hashes.map((hash) => fetchFrame(hash, frame, signal)));
        return fetched.every((picture) => picture !== null) ? fetched : null;
      }, setShown),
    [key],
  );
  useEffect(() => {
    if (visible && sight) pair.take(sight);
  }, [pair, visible, sight?.frame, sight?.seen]);
  useEffect(
    () => () => {
      pair.stop();
      setShown(null);
    },
    [pair],
  );
  return shown;
}

/** Returns what an agent sees, live. With a null `topic` it watches nothing. */
function useLiveSight(topic: string | null): Sight | null {
  const [sight, setSight] = useState<Sight | null>(null);
  useEffect(() => {
    setSight(null);
    if (topic === null) return undefined;
    return live.watch(topic, ({ header, payload }) => {
      const type = typeof header.type === 'string' ? header.type : 'image/jpeg';
      const frame = Number(header.frame);
      setSight({ frame, seen: { state: 'ready', blob: new Blob([new Uint8Array(payload)], { type }), frame } });
    });
  }, [topic]);
  return sight;
}

/** Returns an address of a picture. The previous one stays valid until the new picture is decoded. */
function useAddress(picture: Picture): string | undefined {
  const blob = picture.state === 'ready' ? picture.blob : null;
  const address = useMemo(() => (blob ? URL.createObjectURL(blob) : undefined), [blob]);
  useEffect(() => () => void (address && setTimeout(() => URL.revokeObjectURL(address), 500)), [address]);
  return address;
}

function PictureBox({ picture, wanted, alt, caption }: {
  picture: Picture;
  /** The frame that was asked for. */
  wanted: number | undefined;
  alt: string;
  caption: string;
}): JSX.Element {
  const address = useAddress(picture);
  return (
    <figure class="picture">
      {picture.state === 'ready' ? (
        <img src={address} alt={`${alt}, frame ${picture.frame}`} />
      ) : (
        <div class="hint" role="status">
          {picture.state === 'none' ? picture.text : 'Waiting for the picture'}
        </div>
      )}
      <figcaption class="row between">
        {caption}
        {picture.state === 'ready' && (
          <span class="hint number">
            {picture.frame !== wanted && 'nearest stored: '}frame {picture.frame}
          </span>
        )}
      </figcaption>
    </figure>
  );
}

interface PicturesProps {
  /** Where the agent is; undefined if unknown. */
  on: RunTraversal | undefined;
  name: string;
  alt: string;
  frame: number | null;
  /** The topic of what the agent sees. Without it, the picture of the frame is fetched. */
  topic?: string;
  sibling: RunTraversal | undefined;
}

/** Shows the pictures of a frame of a traversal and of the same place on a sibling, while they are on the screen. */
export function Pictures({ on, name, alt, frame, topic, sibling }: PicturesProps): JSX.Element {
  const room = useRef<HTMLDivElement>(null);
  const visible = useVisible(room);
  const sees = on?.images && topic !== undefined;
  const watched = useLiveSight(visible && sees ? topic : null);
  const sight = sees ? watched : frame === null ? null : { frame, seen: null };
  const fetches = on?.images && !sees ? [on, sibling] : [sibling];
  const shown = usePair(fetches.flatMap((one) => one?.hash ?? []), sight, visible);
  const own = (sees ? shown?.sight.seen : shown?.fetched?.[0]) ?? WAITING;
  return (
    <div class="pictures" ref={room}>
      <PictureBox
        picture={on?.images ? own : { state: 'none', text: 'This traversal has features only.' }}
        wanted={shown?.sight.frame}
        alt={alt}
        caption={name}
      />
      {sibling && (
        <PictureBox
          picture={shown?.fetched?.at(-1) ?? WAITING}
          wanted={shown?.sight.frame}
          alt={`The same place on ${sibling.traversal}`}
          caption={`${sibling.traversal}, same place`}
        />
      )}
    </div>
  );
}

/** Returns the other traversals that have pictures, and the one of them that the address names, else the first. */
export function siblingsOf(all: readonly RunTraversal[], own: Recorded): [readonly RunTraversal[], RunTraversal | undefined] {
  const others = all.filter((one) => !sameTraversal(one, own) && one.images);
  return [others, others.find((one) => one.traversal === param('sibling', '')) ?? others[0]];
}

/** Chooses the traversal on which the same place is shown. Shows nothing unless there are several. */
export function SiblingSelect({ siblings, chosen }: { siblings: readonly RunTraversal[]; chosen: RunTraversal | undefined }): JSX.Element | null {
  if (siblings.length < 2 || !chosen) return null;
  return (
    <Select
      quiet
      label="Sibling traversal"
      value={chosen.traversal}
      options={siblings.map((one) => ({ value: one.traversal, label: `compare with ${one.traversal}` }))}
      onChange={(name) => setParams({ sibling: name })}
    />
  );
}
