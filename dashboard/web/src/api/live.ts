// SPDX-License-Identifier: Apache-2.0
import { signal } from '@preact/signals';
import { alive, getJson, unauthorised } from './client';
import { parseFrame, type Frame } from './frame';

type LinkState =
  | { kind: 'connecting' }
  | { kind: 'open' }
  | { kind: 'waiting'; until: number }; // until: milliseconds since 1970

type Handler = (frame: Frame) => void;

const MAX_TOPICS = 64;
const SILENCE = 15_000;

/** Returns the milliseconds before the n-th attempt (n from 1): from 0.5 s doubling to 10 s, less a random part up to a quarter. */
export function backOff(attempts: number, chance: number): number {
  return Math.min(10_000, 500 * 2 ** (attempts - 1)) * (1 - chance / 4);
}

/**
 * The page's WebSocket. Watches the subscribed topics, reconnects automatically, and notifies subscribers of each
 * reconnection, so that they fetch what they missed from the REST API.
 */
class Live {
  readonly state = signal<LinkState>({ kind: 'connecting' });
  /** When the connection was lost, milliseconds since 1970; null while connected. */
  readonly lostAt = signal<number | null>(null);
  readonly dropped = signal(0);
  private handlers = new Map<string, Set<Handler>>();
  private openHandlers = new Set<() => void>();
  private socket: WebSocket | null = null;
  private attempts = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private watching = '';
  private told = false;
  private heard = 0;

  start(): void {
    this.connect();
    setInterval(() => void this.listen(), 5000);
  }

  /** Subscribes. Returns a function that unsubscribes. */
  watch(topic: string, handler: Handler): () => void {
    let set = this.handlers.get(topic);
    if (!set) this.handlers.set(topic, (set = new Set()));
    set.add(handler);
    this.tell();
    return () => {
      set.delete(handler);
      if (set.size === 0 && this.handlers.get(topic) === set) this.handlers.delete(topic);
      this.tell();
    };
  }

  /** Subscribes to reconnections. Returns a function that unsubscribes. */
  onBack(handler: () => void): () => void {
    this.openHandlers.add(handler);
    return () => this.openHandlers.delete(handler);
  }

  /** Connects at once instead of at the end of the back-off. */
  retry(): void {
    if (this.state.value.kind !== 'waiting') return;
    clearTimeout(this.timer);
    this.connect();
  }

  private connect(): void {
    this.state.value = { kind: 'connecting' };
    const url = new URL('api/live', document.baseURI);
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    const socket = new WebSocket(url);
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    socket.onopen = () => {
      const back = this.lostAt.value !== null;
      this.attempts = 0;
      this.heard = Date.now();
      this.state.value = { kind: 'open' };
      this.lostAt.value = null;
      this.watching = '';
      this.tell();
      if (back) this.openHandlers.forEach((handler) => handler());
    };
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
      this.heard = Date.now();
      let frame: Frame;
      try {
        frame = parseFrame(event.data);
      } catch (error) {
        console.error(error); // a server of another version: reconnect
        socket.close();
        return;
      }
      this.dropped.value = frame.dropped;
      this.handlers.get(frame.topic)?.forEach((handler) => handler(frame));
    };
    socket.onclose = () => {
      if (this.socket === socket) this.lost();
    };
  }

  private lost(): void {
    this.socket = null;
    this.lostAt.value ??= Date.now();
    this.attempts += 1;
    const wait = backOff(this.attempts, Math.random());
    this.state.value = { kind: 'waiting', until: Date.now() + wait };
    this.timer = setTimeout(() => this.connect(), wait);
    // A refused upgrade looks like a dead server: check whether a token is missing.
    if (!unauthorised.value) getJson('api/about').catch(() => undefined);
  }

  // A peer that vanished sends nothing, not even the end of the connection.
  private async listen(): Promise<void> {
    const socket = this.socket;
    if (!socket || this.state.value.kind !== 'open' || Date.now() - this.heard < SILENCE) return;
    if (await alive()) this.heard = Date.now();
    else if (this.socket === socket) {
      socket.close();
      this.lost();
    }
  }

  // Subscriptions of the same moment share one message.
  private tell(): void {
    if (this.told) return;
    this.told = true;
    queueMicrotask(() => {
      this.told = false;
      const message = JSON.stringify({ watch: [...this.handlers.keys()].slice(0, MAX_TOPICS) });
      if (this.socket?.readyState !== WebSocket.OPEN || message === this.watching) return;
      this.watching = message;
      this.socket.send(message);
    });
  }
}

export const live = new Live();
