// Following one job's event stream.

import * as api from "./api.js";

const KINDS = ["state", "progress", "snapshot", "succeeded", "failed", "cancelled"];
const TERMINAL = new Set(["succeeded", "failed", "cancelled"]);
const FIRST_RETRY_MS = 1000;
const LAST_RETRY_MS = 15_000;

/**
 * Reads a job's events from the first to the terminal one. A broken connection is taken up again
 * by EventSource itself, which tells the server the last event it saw; where the server refused,
 * EventSource gives up and the same is done here with `?after=`.
 *
 * `hears` has onEvent(kind, data, seq), onConnection(alive) and onGone().
 */
export class Follower {
  constructor(id, hears) {
    this.id = id;
    this.hears = hears;
    this.seq = 0;
    this.retryMs = FIRST_RETRY_MS;
    // Browsers allow few connections to a server; tabs in the background leave theirs to others.
    this.onVisibility = () => (document.hidden ? this.pause() : this.open());
    document.addEventListener("visibilitychange", this.onVisibility);
    this.open();
  }

  pause() {
    clearTimeout(this.timer);
    this.source.close();
  }

  open() {
    this.source?.close();
    const source = new EventSource(`/v1/jobs/${encodeURIComponent(this.id)}/events?after=${this.seq}`);
    this.source = source;
    source.addEventListener("open", () => {
      this.retryMs = FIRST_RETRY_MS;
      this.hears.onConnection(true);
    });
    source.addEventListener("error", () => this.broken());
    for (const kind of KINDS) {
      source.addEventListener(kind, (event) => {
        const seq = Number(event.lastEventId);
        if (seq <= this.seq) return;
        this.seq = seq;
        // The stream ends here; without closing it EventSource would ask again for ever.
        if (TERMINAL.has(kind)) this.close();
        this.hears.onEvent(kind, JSON.parse(event.data), seq);
      });
    }
  }

  async broken() {
    if (this.closed) return;
    this.hears.onConnection(false);
    if (this.source.readyState !== EventSource.CLOSED) return;
    try {
      await api.job(this.id);
    } catch (problem) {
      if (problem.status === 404 && !this.closed) {
        this.close();
        this.hears.onGone();
      }
    }
    if (this.closed || document.hidden) return;
    this.timer = setTimeout(() => this.open(), this.retryMs);
    this.retryMs = Math.min(2 * this.retryMs, LAST_RETRY_MS);
  }

  close() {
    this.closed = true;
    document.removeEventListener("visibilitychange", this.onVisibility);
    this.pause();
  }
}
