// Following one job's event stream.

import * as api from "./api.js";
import * as key from "./key.js";

const TERMINAL = new Set(["succeeded", "failed", "cancelled"]);
const FIRST_RETRY_MS = 1000;
const LAST_RETRY_MS = 15_000;

/** Reads server-sent events out of a body; `hear(kind, data, seq)` has each. */
async function readEvents(body, hear) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    // What comes after the last empty line is not whole yet.
    const frames = text.split("\n\n");
    text = frames.pop();
    for (const frame of frames) {
      const fields = new Map();
      for (const line of frame.split("\n")) {
        const at = line.indexOf(":");
        if (at > 0) fields.set(line.slice(0, at), line.slice(at + 1).replace(/^ /, ""));
      }
      if (fields.has("data")) hear(fields.get("event"), JSON.parse(fields.get("data")), Number(fields.get("id")));
    }
  }
}

/**
 * Reads a job's events from the first to the terminal one, with `fetch`, because EventSource sends
 * no key. A broken connection is taken up again after the last event that was seen.
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
    this.stop?.abort();
  }

  async open() {
    this.pause();
    const stop = new AbortController();
    this.stop = stop;
    try {
      const path = `/v1/jobs/${encodeURIComponent(this.id)}/events?after=${this.seq}`;
      const response = await fetch(path, { headers: key.headers(), signal: stop.signal, cache: "no-store" });
      if (!response.ok) throw new Error(`The server answered ${response.status}.`);
      this.retryMs = FIRST_RETRY_MS;
      this.hears.onConnection(true);
      await readEvents(response.body, (kind, data, seq) => {
        if (stop.signal.aborted || seq <= this.seq) return;
        this.seq = seq;
        if (TERMINAL.has(kind)) this.close();
        this.hears.onEvent(kind, data, seq);
      });
    } catch {
      // The same as an end before the last event.
    }
    if (!stop.signal.aborted) this.broken();
  }

  async broken() {
    if (this.closed) return;
    this.hears.onConnection(false);
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
