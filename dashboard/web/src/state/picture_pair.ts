// SPDX-License-Identifier: Apache-2.0
export type Picture = { state: 'none'; text: string } | { state: 'waiting' } | { state: 'ready'; blob: Blob; frame: number };

/** A frame to show, with the picture that the agent sees there if it came on its own. */
export interface Sight {
  frame: number;
  seen: Picture | null;
}

/** What is shown at once. Every picture is of the sight's frame. */
export interface Shown {
  sight: Sight;
  /** The pictures that were fetched; null while they are on their way. */
  fetched: Picture[] | null;
}

/** Fetches the pictures of a frame. Returns null without a connection. */
export type Fetch = (frame: number, signal: AbortSignal) => Promise<Picture[] | null>;

/** What is being fetched. It is late after PATIENCE. */
interface Request {
  frame: number;
  late: boolean;
  abort: AbortController;
  timer: ReturnType<typeof setTimeout>;
}

const PATIENCE = 500; // milliseconds that a sight waits for its fetched pictures before it is shown without them

/**
 * Shows pictures of one frame together: what an agent sees, and the same place on other traversals, which must be fetched.
 * While they are fetched the pictures before stay. If that takes long, the newest sight is shown and the others are waited for.
 */
export class PicturePair {
  private newest: Sight | null = null;
  private shown: Shown | null = null;
  private request: Request | null = null;

  constructor(
    private readonly fetch: Fetch,
    private readonly show: (shown: Shown) => void,
  ) {}

  /** Takes the newest sight. */
  take(sight: Sight): void {
    this.newest = sight;
    if (!this.request) this.next();
    else if (this.request.late) this.showLate();
  }

  stop(): void {
    this.cancel();
    this.newest = null;
  }

  private next(): void {
    const sight = this.newest;
    if (!sight) return;
    if (this.shown?.fetched && this.shown.sight.frame === sight.frame) {
      this.put({ sight, fetched: this.shown.fetched });
      return;
    }
    const abort = new AbortController();
    const timer = setTimeout(() => {
      request.late = true;
      this.showLate();
    }, PATIENCE);
    const request: Request = { frame: sight.frame, late: false, abort, timer };
    this.request = request;
    void this.fetch(sight.frame, abort.signal).then((fetched) => {
      if (this.request !== request) return;
      this.cancel();
      this.put({ sight, fetched });
      if (fetched && this.newest !== sight) this.next();
    });
  }

  /** Shows the newest sight without the pictures that are late, and asks for those of its own frame. */
  private showLate(): void {
    if (!this.newest) return;
    this.put({ sight: this.newest, fetched: null });
    if (this.newest.frame === this.request?.frame) return;
    this.cancel();
    this.next();
  }

  private cancel(): void {
    this.request?.abort.abort();
    clearTimeout(this.request?.timer);
    this.request = null;
  }

  private put(shown: Shown): void {
    this.shown = shown;
    this.show(shown);
  }
}
