// The list of jobs. Rows are kept and updated in place, so that focus and scrolling survive.

import { loadable } from "./key.js";
import { h, setAttribute, setText, setVariable } from "./dom.js";
import { ago, count, fullTime, isTerminal, percent, pixels, seconds, stateName } from "./format.js";

const FILTERS = [
  ["", "All"],
  ["running", "Running"],
  ["queued", "Queued"],
  ["succeeded", "Done"],
  ["failed", "Failed"],
  ["cancelled", "Cancelled"],
];
/** Larger pictures are too much to load for a thumbnail. */
const MAX_THUMBNAIL_PIXELS = 1 << 21;

export class JobList {
  /** `hears` has onFilter(filter) and onMore(); `nameOf(job)` gives a job's title. */
  constructor(root, nameOf, hears) {
    this.nameOf = nameOf;
    this.hears = hears;
    this.rows = new Map();
    this.pictures = new Map();
    this.filter = { state: "", label: "" };
    this.rowsRoot = h("ol", { class: "rows" });
    this.empty = h("p", { class: "list-empty", hidden: true });
    this.more = h("button", { type: "button", class: "button quiet more", hidden: true, on: { click: () => hears.onMore() } }, "Show more");
    this.tabs = new Map();
    const tabs = h("div", { class: "filters", role: "group", "aria-label": "Show jobs by state" });
    for (const [state, name] of FILTERS) {
      const number = h("span", { class: "number" });
      const tab = h("button", { type: "button", class: "filter", "data-state": state, on: { click: () => this.setFilter({ state }) } }, name, number);
      this.tabs.set(state, { tab, number });
      tabs.append(tab);
    }
    this.label = h("button", { type: "button", class: "chip removable", hidden: true, title: "Show all labels again", on: { click: () => this.setFilter({ label: "" }) } });
    root.append(h("h1", { class: "list-title" }, "Jobs"), tabs, this.label, this.rowsRoot, this.empty, this.more);
    this.markFilter();
  }

  setFilter(change) {
    this.filter = { ...this.filter, ...change };
    this.markFilter();
    this.hears.onFilter(this.filter);
  }

  markFilter() {
    for (const [state, { tab }] of this.tabs) setAttribute(tab, "aria-pressed", String(state === this.filter.state));
    this.label.hidden = !this.filter.label;
    setText(this.label, `Label ${this.filter.label}`);
  }

  setCounts(counts) {
    const all = Object.values(counts).reduce((sum, n) => sum + n, 0);
    for (const [state, { number }] of this.tabs) setText(number, count(state ? (counts[state] ?? 0) : all));
  }

  /** The newest picture of a job that still runs; ended jobs name theirs themselves. */
  setPicture(id, url) {
    this.pictures.set(id, url);
  }

  setSelected(id) {
    this.selected = id;
    for (const [other, row] of this.rows) setAttribute(row.link, "aria-current", other === id ? "page" : null);
  }

  show(jobs, hasMore) {
    const ids = new Set(jobs.map((job) => job.id));
    for (const [id, row] of this.rows) {
      if (!ids.has(id)) {
        row.root.remove();
        this.rows.delete(id);
      }
    }
    let before = this.rowsRoot.firstElementChild;
    for (const job of jobs) {
      let row = this.rows.get(job.id);
      if (!row) {
        row = newRow(job.id);
        this.rows.set(job.id, row);
      }
      if (row.root === before) before = before.nextElementSibling;
      else this.rowsRoot.insertBefore(row.root, before);
      this.update(row, job);
    }
    this.setSelected(this.selected);
    this.more.hidden = !hasMore;
    this.empty.hidden = jobs.length > 0;
    const filtered = this.filter.state || this.filter.label;
    setText(this.empty, filtered ? "No job matches this filter." : "No jobs yet.");
  }

  update(row, job) {
    const { request, progress } = job;
    setAttribute(row.root, "data-state", job.state);
    setText(row.name, this.nameOf(job));
    setText(row.created, ago(job.created_at));
    setAttribute(row.created, "datetime", job.created_at);
    setAttribute(row.created, "title", fullTime(job.created_at));
    setText(row.state, stateName(job));
    setAttribute(row.state, "data-state", job.state);
    setText(row.method, job.plan?.method ?? request.method);
    setText(row.size, pixels(request.width, request.height));
    const running = job.state === "running";
    row.bar.hidden = !running;
    if (running) {
      const share = progress?.fraction ?? 0;
      setVariable(row.bar, "--share", share);
      setAttribute(row.bar, "aria-valuenow", Math.round(100 * share));
    }
    setText(row.time, timeText(job));
    setText(row.error, job.estimated_error === null ? "" : `error ${percent(job.estimated_error)}`);
    this.updateThumbnail(row, job);
  }

  updateThumbnail(row, job) {
    const { width, height } = job.request;
    const final = job.result?.find((picture) => picture.format === "png")?.url;
    const url = width * height <= MAX_THUMBNAIL_PIXELS ? (final ?? this.pictures.get(job.id)) : undefined;
    if (url && row.shown !== url) {
      row.shown = url;
      loadable(url).then((address) => {
        row.thumbnail.src = address;
        row.thumbnail.hidden = false;
      }, () => {
        row.shown = undefined;
      });
    }
  }
}

function timeText(job) {
  if (job.state === "queued") return `waiting ${seconds(job.timings.queued_s)}`;
  if (isTerminal(job.state)) return seconds(job.stats?.seconds_total ?? job.timings.running_s);
  const { progress } = job;
  if (!progress) return "starting";
  const left = progress.seconds_remaining;
  return left === null ? seconds(progress.seconds) : `${seconds(progress.seconds)} · ${seconds(left)} left`;
}

function newRow(id) {
  const row = {
    thumbnail: h("img", { alt: "", loading: "lazy", decoding: "async", hidden: true }),
    name: h("span", { class: "row-name" }),
    created: h("time", { class: "row-created" }),
    state: h("span", { class: "pill" }),
    method: h("span"),
    size: h("span"),
    bar: h("div", { class: "bar", role: "progressbar", "aria-label": "Progress", "aria-valuemin": 0, "aria-valuemax": 100 }, h("div", { class: "bar-fill" })),
    time: h("span", { class: "row-time" }),
    error: h("span", { class: "row-error", title: "Estimated relative error" }),
  };
  row.link = h("a", { class: "row", href: `#/jobs/${id}` },
    h("span", { class: "thumbnail" }, row.thumbnail),
    h("span", { class: "row-text" },
      h("span", { class: "row-line" }, row.name, row.created),
      h("span", { class: "row-line facts" }, row.state, row.method, row.size),
      row.bar,
      h("span", { class: "row-line figures" }, row.time, row.error)));
  row.root = h("li", {}, row.link);
  return row;
}
