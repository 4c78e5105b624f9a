// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useRef, useState } from 'preact/hooks';
import { ApiError, request } from '../api/client';
import { live } from '../api/live';
import type { RunTraversal } from '../api/types';
import { patiently } from '../state/resource';
import { useVisible } from './use';

type Picture = { state: 'none'; text: string } | { state: 'waiting' } | { state: 'ready'; src: string; frame: number };

const WAITING: Picture = { state: 'waiting' };
const KEPT = 5000; // ms

/** Fetches the picture of a frame, or says why there is none. Returns null without a connection: the banner reports that. */
async function fetchFrame(path: string, frame: number, abort: AbortSignal): Promise<Picture | null> {
  try {
    const response = await patiently(() => request(path, { signal: abort }), abort);
    return { state: 'ready', src: URL.createObjectURL(await response.blob()), frame };
  } catch (error) {
    if (!(error instanceof ApiError) || error.status === 0) return null;
    const gone = error.status === 404;
    return { state: 'none', text: gone ? 'This place has no picture, or its env_service does not run.' : `The picture could not be loaded (${error.status}).` };
  }
}

/** Returns the picture of a frame; the previous one stays until it is there. One request at a time, the newest wins. */
function useFrame(hash: string | null, frame: number | null, visible: boolean): Picture {
  const [answer, setAnswer] = useState<{ hash: string; frame: number; picture: Picture } | null>(null);
  const busy = useRef<AbortController | null>(null);
  useEffect(() => {
    if (hash === null || frame === null || !visible || busy.current || (answer?.hash === hash && answer.frame === frame)) return;
    const abort = (busy.current = new AbortController());
    void fetchFrame(`api/frames/${hash}/${frame}`, frame, abort.signal).then((picture) => {
      busy.current = null;
      if (!abort.signal.aborted) setAnswer((old) => ({ hash, frame, picture: picture ?? old?.picture ?? WAITING }));
      else if (picture?.state === 'ready') URL.revokeObjectURL(picture.src);
    });
  }, [hash, frame, visible, answer]);
  useEffect(() => () => busy.current?.abort(), []);
  const picture = answer?.hash === hash ? answer.picture : WAITING;
  const src = answer?.picture.state === 'ready' ? answer.picture.src : null;
  useEffect(() => () => (src === null ? undefined : URL.revokeObjectURL(src)), [src]);
  return picture;
}

/** Returns what an agent sees, live. With a null `topic` it watches nothing. */
function useLivePicture(topic: string | null): Picture {
  const [picture, setPicture] = useState<Picture>(WAITING);
  useEffect(() => {
    setPicture(WAITING);
    if (topic === null) return undefined;
    let url: string | null = null;
    const stop = live.watch(topic, (frame) => {
      const old = url;
      const { type } = frame.header;
      url = URL.createObjectURL(new Blob([new Uint8Array(frame.payload)], { type: typeof type === 'string' ? type : 'image/jpeg' }));
      setPicture({ state: 'ready', src: url, frame: Number(frame.header.frame) });
      // The previous one stays on the screen until the new one is decoded, and waits for the same place on a sibling.
      if (old) setTimeout(() => URL.revokeObjectURL(old), KEPT);
    });
    return () => {
      stop();
      if (url) URL.revokeObjectURL(url);
    };
  }, [topic]);
  return picture;
}

/** An agent's picture and the same place on a sibling. */
interface Pair {
  own: Picture;
  other: Picture;
}

/** Returns the newest picture with that of the same frame of a sibling: both change together, once both are there. */
function usePair(own: Picture, hash: string | null, visible: boolean): Pair {
  const [pair, setPair] = useState<Pair & { hash: string | null }>({ own: WAITING, other: WAITING, hash });
  const busy = useRef<AbortController | null>(null);
  useEffect(() => {
    if (hash === null || own.state !== 'ready' || !visible || busy.current || (pair.hash === hash && pair.own === own)) return;
    const abort = (busy.current = new AbortController());
    void fetchFrame(`api/frames/${hash}/${own.frame}`, own.frame, abort.signal).then((other) => {
      busy.current = null;
      if (!abort.signal.aborted) setPair({ own, other: other ?? WAITING, hash });
      else if (other?.state === 'ready') URL.revokeObjectURL(other.src);
    });
  }, [own, hash, visible, pair]);
  useEffect(() => () => busy.current?.abort(), []);
  const src = pair.other.state === 'ready' ? pair.other.src : null;
  useEffect(() => () => (src === null ? undefined : URL.revokeObjectURL(src)), [src]);
  return hash !== null && own.state === 'ready' && pair.hash === hash ? pair : { own, other: WAITING };
}

function PictureBox({ picture, alt, caption }: { picture: Picture; alt: string; caption: string }): JSX.Element {
  return (
    <figure class="picture">
      {picture.state === 'ready' ? (
        <img src={picture.src} alt={`${alt}, frame ${picture.frame}`} />
      ) : (
        <div class="hint" role="status">
          {picture.state === 'none' ? picture.text : 'Waiting for the picture'}
        </div>
      )}
      <figcaption class="row between">
        {caption}
        {picture.state === 'ready' && <span class="hint number">frame {picture.frame}</span>}
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
  /** Whether the agent acts no more. */
  ended?: boolean;
}

/** Shows the pictures of a frame of a traversal and of the same place on a sibling, while they are on the screen. */
export function Pictures({ on, name, alt, frame, topic, sibling, ended = false }: PicturesProps): JSX.Element {
  const room = useRef<HTMLDivElement>(null);
  const visible = useVisible(room);
  const watched = useLivePicture(visible && on?.images && topic ? topic : null);
  const fetched = useFrame(on?.images && !topic ? on.hash : null, frame, visible);
  const newest: Picture = !on?.images
    ? { state: 'none', text: 'This traversal has features only.' }
    : !topic
      ? fetched
      : watched.state === 'waiting' && ended
        ? { state: 'none', text: 'This run has ended, so no agent sees anything.' }
        : watched;
  const pair = usePair(newest, sibling?.hash ?? null, visible);
  // Without a picture of its own, the agent's place is known all the same.
  const alone = useFrame(newest.state === 'none' ? (sibling?.hash ?? null) : null, frame, visible);
  const own = pair.own;
  const other = newest.state === 'none' ? alone : pair.other;
  return (
    <div class="pictures" ref={room}>
      <PictureBox picture={own} alt={alt} caption={name} />
      {sibling && <PictureBox picture={other} alt={`The same place on ${sibling.traversal}`} caption={`${sibling.traversal}, same place`} />}
    </div>
  );
}
