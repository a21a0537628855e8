// Numbers with their units, times, names.

const whole = new Intl.NumberFormat("en");
const short = new Intl.NumberFormat("en", { notation: "compact", maximumSignificantDigits: 4 });
const clockTime = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit", second: "2-digit" });
const dayTime = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" });

/** No-break space: a number stays with its unit. */
const NBSP = "\u00a0";
export const NONE = "–";

const missing = (x) => x === null || x === undefined || !Number.isFinite(x);

/** A share of 1 as per cent, three significant digits where they say something. */
export function percent(share) {
  if (missing(share)) return NONE;
  const value = 100 * share;
  if (value >= 999.5) return `${whole.format(Math.round(value))}${NBSP}%`;
  return `${value.toFixed(value >= 99.95 ? 0 : value >= 9.995 ? 1 : 2)}${NBSP}%`;
}

/** What an error most likely lies between; a line of its own height where that is not known. */
export function boundsText(bounds) {
  return bounds ? `${percent(bounds.low)} to ${percent(bounds.high)}` : NBSP;
}

/** A count; beyond ten millions in short form. */
export function count(n) {
  if (missing(n)) return NONE;
  return n < 1e7 ? whole.format(n) : short.format(n);
}

export function seconds(s) {
  if (missing(s)) return NONE;
  if (s < 9.95) return `${s.toFixed(1)}${NBSP}s`;
  if (s < 59.5) return `${Math.round(s)}${NBSP}s`;
  const all = Math.round(s);
  const two = (n) => String(n).padStart(2, "0");
  if (all < 3600) return `${Math.floor(all / 60)}${NBSP}min${NBSP}${two(all % 60)}${NBSP}s`;
  return `${Math.floor(all / 3600)}${NBSP}h${NBSP}${two(Math.floor((all % 3600) / 60))}${NBSP}min`;
}

export function bytes(n) {
  if (missing(n)) return NONE;
  const units = ["B", "KiB", "MiB", "GiB"];
  let unit = 0;
  while (n >= 1023.5 && unit < units.length - 1) {
    n /= 1024;
    unit += 1;
  }
  return `${unit === 0 || n >= 99.5 ? Math.round(n) : n.toFixed(1)}${NBSP}${units[unit]}`;
}

export const pixels = (width, height) => `${width}${NBSP}×${NBSP}${height}`;

export const clock = (time) => clockTime.format(time);

/** Since when, in few words. */
export function ago(timestamp) {
  const then = new Date(timestamp);
  const passed = (Date.now() - then.getTime()) / 1000;
  if (passed < 10) return "now";
  if (passed < 60) return `${Math.floor(passed / 10) * 10}${NBSP}s ago`;
  if (passed < 3600) return `${Math.floor(passed / 60)}${NBSP}min ago`;
  if (passed < 12 * 3600) return `${Math.floor(passed / 3600)}${NBSP}h ago`;
  return dayTime.format(then);
}

/** Date and time in full, for titles. */
export const fullTime = (timestamp) => new Date(timestamp).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "medium" });

/** The random end of a UUIDv7; its beginning is the time and the same for neighbours. */
export const shortId = (id) => id.slice(-8);

export const shortHash = (hash) => hash.slice(0, 8);

const STATES = { queued: "Queued", running: "Running", succeeded: "Done", failed: "Failed", cancelled: "Cancelled" };

export const stateName = (job) =>
  job.cancel_requested && job.state === "running" ? "Cancelling" : (STATES[job.state] ?? job.state);

export const isTerminal = (state) => state === "succeeded" || state === "failed" || state === "cancelled";

const STOPPED = {
  time_budget: "time budget used up",
  server_limit: "longest time of this server used up",
  iterations: "iterations done",
  target_error: "target error reached",
  cancelled: "cancelled",
  converged: "the method has nothing more to do",
  no_light: "the scene has no light",
};

export const stopReason = (stopped) => STOPPED[stopped] ?? stopped;

/** `snake_case` in words. */
export const words = (name) => name.replaceAll("_", " ");
