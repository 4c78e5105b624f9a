// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useRef, useState } from 'preact/hooks';
import { live } from '../api/live';

export type Picture =
  | { state: 'none'; text: string }
  | { state: 'waiting' }
  | { state: 'ready'; src: string; frame: number };

/** Fetches the picture of a frame; the previous one stays until it is there. One request at a time, the newest wins. */
export function useFrame(hash: string | null, frame: number | null, visible: boolean): Picture {
  const [picture, setPicture] = useState<Picture>({ state: 'waiting' });
  const wanted = useRef<{ hash: string; frame: number } | null>(null);
  const busy = useRef(false);
  const timer = useRef<ReturnType<typeof setTimeout>>();
  const url = useRef<string | null>(null);

  const show = (next: Picture): void => {
    if (url.current) URL.revokeObjectURL(url.current);
    url.current = next.state === 'ready' ? next.src : null;
    setPicture(next);
  };
  const load = async (): Promise<void> => {
    const ask = wanted.current;
    if (busy.current || !ask) return;
    busy.current = true;
    try {
      const response = await fetch(`api/frames/${ask.hash}/${ask.frame}`);
      if (response.ok) {
        const src = URL.createObjectURL(await response.blob());
        if (wanted.current?.hash === ask.hash) show({ state: 'ready', src, frame: ask.frame });
        else URL.revokeObjectURL(src);
      } else if (response.status === 503) {
        const seconds = Number(response.headers.get('Retry-After')) || 1;
        timer.current = setTimeout(() => void load(), 1000 * seconds);
      } else if (response.status === 404) {
        show({ state: 'none', text: 'No picture of this place, or its env_service is not there.' });
      } else {
        show({ state: 'none', text: `The picture did not come (${response.status}).` });
      }
    } catch {
      // No connection: the banner reports it.
    }
    busy.current = false;
    const next = wanted.current;
    if (next && (next.hash !== ask.hash || next.frame !== ask.frame)) void load();
  };
  useEffect(() => {
    if (hash === null || frame === null || !visible) {
      wanted.current = null;
      return undefined;
    }
    if (wanted.current?.hash !== hash) setPicture({ state: 'waiting' });
    wanted.current = { hash, frame };
    clearTimeout(timer.current);
    void load();
    return undefined;
  }, [hash, frame, visible]);
  useEffect(
    () => () => {
      wanted.current = null;
      clearTimeout(timer.current);
      if (url.current) URL.revokeObjectURL(url.current);
    },
    [],
  );
  return picture;
}

/** Returns what an agent sees, live. With a null `topic` it watches nothing. */
export function useLivePicture(topic: string | null): Picture {
  const [picture, setPicture] = useState<Picture>({ state: 'waiting' });
  useEffect(() => {
    setPicture({ state: 'waiting' });
    if (topic === null) return undefined;
    let url: string | null = null;
    const stop = live.watch(topic, (frame) => {
      const old = url;
      const { type } = frame.header;
      url = URL.createObjectURL(new Blob([new Uint8Array(frame.payload)], { type: typeof type === 'string' ? type : 'image/jpeg' }));
      setPicture({ state: 'ready', src: url, frame: Number(frame.header.frame) });
      // The previous one stays on the screen until the new one is decoded.
      if (old) setTimeout(() => URL.revokeObjectURL(old), 500);
    });
    return () => {
      stop();
      if (url) URL.revokeObjectURL(url);
    };
  }, [topic]);
  return picture;
}

export function PictureBox({ picture, alt, caption }: { picture: Picture; alt: string; caption: string }): JSX.Element {
  return (
    <figure class="picture">
      {picture.state === 'ready' ? (
        <img src={picture.src} alt={`${alt}, frame ${picture.frame}`} />
      ) : (
        <div class="picture-none" role="status">
          {picture.state === 'none' ? picture.text : 'Waiting for the picture'}
        </div>
      )}
      <figcaption>
        {caption}
        {picture.state === 'ready' && <span class="number">frame {picture.frame}</span>}
      </figcaption>
    </figure>
  );
}
