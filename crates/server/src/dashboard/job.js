// One job, live: picture, figures, error chart, what was asked for and what happened.

import * as api from "./api.js";
import { ErrorChart } from "./chart.js";
import { announce, copyButton, h, icon, setAttribute, setText, setVariable } from "./dom.js";
import { Follower } from "./follow.js";
import { boundsText, bytes, count, fullTime, isTerminal, NONE, percent, pixels, seconds, shortId, stateName, stopReason, words } from "./format.js";
import { PictureView } from "./picture.js";

/** How often the record itself is read while the job runs: device, attempts, timings. */
const REREAD_MS = 3000;
const MAX_LOG_LINES = 300;

const FIGURES = [
  ["error", "Estimated error", "Relative error (rRMSE) of the present picture, estimated without a reference, and what it most likely lies between"],
  ["iterations", "Iterations", "Whole iterations of the method"],
  ["shots", "Shots", "Hemicubes shot"],
  ["ratio", "Light-source selection ratio", "Share of shots whose shooter is a light source; of rays, the share cast at one"],
  ["time", "Solving time", "Seconds of preparing, solving and measuring"],
  ["left", "Remaining", "Expected time to the nearest limit"],
  ["device", "Device", "Where the job runs or ran"],
  ["attempts", "Attempts", "A failure makes another attempt necessary, up to five"],
];

export class JobView {
  /** `hears` has onChange(job), onPicture(id, url), onConnection(alive), onGone(), onLabel(label). */
  constructor(job, nameOf, hears) {
    this.id = job.id;
    this.nameOf = nameOf;
    this.hears = hears;
    this.points = [];
    this.build(job);
    this.update(job);
    this.loadTrace();
    this.follower = new Follower(job.id, {
      onEvent: (kind, data, seq) => this.hear(kind, data, seq),
      onConnection: hears.onConnection,
      onGone: hears.onGone,
    });
    this.timer = setInterval(() => {
      if (!isTerminal(this.job.state) && !document.hidden) this.reread();
    }, REREAD_MS);
  }

  build(job) {
    const { request } = job;
    this.title = h("h2", { class: "job-title", tabindex: "-1" });
    this.state = h("span", { class: "pill large" });
    this.cancelButton = h("button", { type: "button", class: "button", on: { click: () => this.cancel() } }, icon("stop"), h("span", {}, "Cancel"));
    this.deleteButton = h("button", { type: "button", class: "button danger", on: { click: () => this.askToDelete() } }, icon("trash"), "Delete");
    this.downloads = { png: download("PNG"), exr: download("EXR") };
    this.notice = h("div", { class: "notice bad", hidden: true });
    this.picture = new PictureView(request.width, request.height, (url) => this.hears.onPicture(this.id, url));
    this.figures = new Map();
    this.bounds = h("dd", { class: "figure-note" }, boundsText(null));
    const figures = h("dl", { class: "figures-grid" });
    for (const [key, name, meaning] of FIGURES) {
      const value = h("dd");
      this.figures.set(key, value);
      const note = key === "error" ? [this.bounds] : [];
      figures.append(h("div", { class: `figure figure-${key}`, title: meaning }, h("dt", {}, name), value, note));
    }
    this.bar = h("div", { class: "bar thick", role: "progressbar", "aria-label": "Progress of the job", "aria-valuemin": 0, "aria-valuemax": 100 }, h("div", { class: "bar-fill" }));
    this.progressText = h("p", { class: "progress-text" });
    this.chart = new ErrorChart();
    this.plan = h("div", { class: "card-body" });
    this.warnings = h("section", { class: "card", hidden: true });
    this.log = h("ol", { class: "log", tabindex: "0", "aria-label": "Events, newest first" });

    this.root = h("article", { class: "job" },
      h("a", { class: "button small quiet back", href: "#/" }, icon("back"), "All jobs"),
      h("header", { class: "job-head" },
        h("div", { class: "job-names" }, h("div", { class: "job-title-line" }, this.title, this.state), this.facts(job)),
        h("div", { class: "job-actions" }, this.downloads.png, this.downloads.exr, this.cancelButton, this.deleteButton)),
      this.notice,
      h("div", { class: "job-top" },
        h("section", { class: "card picture-card", "aria-label": "Picture" }, this.picture.root),
        h("div", { class: "job-side" },
          h("section", { class: "card", "aria-label": "Figures" }, h("div", { class: "progress" }, this.progressText, this.bar), figures),
          h("section", { class: "card" },
            h("div", { class: "card-head" }, h("h3", {}, "Error over time"), h("div", { class: "card-links" },
              h("a", { class: "button small quiet", href: `/v1/jobs/${job.id}/chart.svg`, target: "_blank", title: "The chart as it is now, as a file of its own" }, icon("download"), "SVG"),
              h("a", { class: "button small quiet", href: `/v1/jobs/${job.id}/trace.csv`, download: `${shortId(job.id)}.csv`, title: "The numbers" }, icon("download"), "CSV"))),
            this.chart.root))),
      this.warnings,
      h("div", { class: "job-bottom" },
        h("section", { class: "card" }, h("div", { class: "card-head" }, h("h3", {}, "Plan")), this.plan),
        h("section", { class: "card" }, h("div", { class: "card-head" }, h("h3", {}, "Request"), copyButton("Copy as curl", () => api.curlFor(trimmed(request)))), this.requestTable(job)),
        h("section", { class: "card" }, h("div", { class: "card-head" }, h("h3", {}, "Events")), this.log)));
  }

  facts(job) {
    const labels = Object.entries(job.request.labels).filter(([key]) => key !== "name");
    return h("p", { class: "job-facts" },
      h("code", { title: job.id }, shortId(job.id)),
      copyButton("Copy id", () => job.id),
      h("time", { datetime: job.created_at }, fullTime(job.created_at)),
      labels.map(([key, value]) => h("button", {
        type: "button", class: "chip", title: "Show only jobs with this label",
        on: { click: () => this.hears.onLabel(`${key}:${value}`) },
      }, `${key}: ${value}`)));
  }

  requestTable(job) {
    const { request } = job;
    const limits = [
      request.time_budget_s !== null && seconds(request.time_budget_s),
      request.max_iterations !== null && `${count(request.max_iterations)} iterations`,
      request.target_error !== null && `error ${percent(request.target_error)}`,
    ].filter(Boolean);
    const camera = request.camera;
    const rows = [
      ["Scene", h("span", {}, job.scene_name ? `${job.scene_name} ` : "", h("code", { title: job.scene }, `${job.scene.slice(0, 16)}…`))],
      ["Picture", pixels(request.width, request.height)],
      ["Camera", camera === null ? "the scene's first" : typeof camera === "object" ? "its own" : String(camera)],
      ...(request.variant ? [["Materials", request.variant]] : []),
      ...(request.gltf_scene !== undefined ? [["Scene in the file", String(request.gltf_scene)]] : []),
      ...(request.animation !== undefined ? [["Animation", `${request.animation} at ${request.time ?? 0} s`]] : []),
      ...(request.environment ? [["Surroundings", surroundings(request.environment)]] : []),
      ...(request.background ? [["Background", Array.isArray(request.background) ? `radiance ${request.background.join(", ")}` : request.background]] : []),
      ...(request.units ? [["Units", request.units]] : []),
      ["Stops at", limits.length ? limits.join(" or ") : "10 s (default)"],
      ["Method", request.method],
      ["Seed", String(request.seed)],
      ["Snapshots", request.snapshots ? `every ${seconds(request.snapshots.every_s)}, ${request.snapshots.formats.join(" and ").toUpperCase()}` : "none"],
      ...(request.priority ? [["Priority", String(request.priority)]] : []),
      ...Object.entries(request.options).map(([name, value]) => [words(name), String(value)]),
    ];
    return h("div", { class: "card-body" }, table(rows));
  }

  async loadTrace() {
    try {
      const points = await api.trace(this.id);
      // The stream may have been faster.
      const last = points.at(-1)?.seconds ?? 0;
      this.points = [...points, ...this.points.filter((point) => point.seconds > last)];
      this.drawChart();
    } catch {
      // The stream replays the same points.
    }
  }

  drawChart() {
    this.chart.show(this.points, this.job.request.target_error, isTerminal(this.job.state));
  }

  hear(kind, data, seq) {
    if (kind === "progress") {
      if (this.fence !== undefined && data.fence > this.fence) this.points = [];
      this.fence = Math.max(data.fence, this.fence ?? 0);
      if (data.seconds > (this.points.at(-1)?.seconds ?? -1)) {
        this.points.push(data);
        this.drawChart();
      }
      this.showProgress(data);
      return;
    }
    if (kind === "snapshot") {
      const png = data.pictures.find((picture) => picture.format === "png");
      if (png) this.picture.add(png.url, data.progress);
      for (const picture of data.pictures) this.offer(picture.format, picture.size);
      this.write(seq, "snapshot", `${seconds(data.progress.seconds)}, ${count(data.progress.iterations)} iterations, error ${percent(data.progress.estimated_error)}`, png?.url);
      return;
    }
    if (kind === "notice") {
      this.write(seq, "notice", data.detail);
      return;
    }
    // What a later server may say is no news of the state.
    if (!("state" in data)) return;
    const text = [data.attempts > 1 && `attempt ${data.attempts}`, data.reason, data.error?.detail].filter(Boolean).join("; ");
    this.write(seq, data.state, text);
    if (isTerminal(data.state) !== isTerminal(this.job.state) || data.state !== this.job.state) this.reread();
  }

  write(seq, kind, text, url) {
    const what = url ? h("a", { href: url, target: "_blank", rel: "noopener" }, text) : text;
    this.log.prepend(h("li", { "data-kind": kind }, h("span", { class: "log-seq" }, String(seq)), h("span", { class: "log-kind" }, kind), h("span", { class: "log-text" }, what)));
    if (this.log.childElementCount > MAX_LOG_LINES) this.log.lastElementChild.remove();
  }

  async reread() {
    try {
      this.update(await api.job(this.id));
    } catch (problem) {
      if (problem.status === 404) this.hears.onGone();
    }
  }

  update(job) {
    if (this.closed) return;
    const before = this.job?.state;
    this.job = job;
    const name = this.nameOf(job);
    setText(this.title, name);
    document.title = `${stateName(job)}: ${name} – Hemilux`;
    setText(this.state, stateName(job));
    setAttribute(this.state, "data-state", job.state);
    setAttribute(this.root, "data-state", job.state);
    const ended = isTerminal(job.state);
    const stopping = job.cancel_requested && !ended;
    this.cancelButton.disabled = ended || stopping;
    setText(this.cancelButton.lastElementChild, stopping ? "Cancelling…" : "Cancel");
    this.notice.hidden = !job.error;
    if (job.error) this.notice.replaceChildren(h("strong", {}, `Failed (${words(job.error.code)}): `), job.error.detail);
    setText(this.figures.get("device"), job.device ?? NONE);
    setText(this.figures.get("attempts"), String(job.attempts));
    this.picture.setPlaceholder(placeholder(job));
    for (const picture of job.result ?? []) {
      this.offer(picture.format, picture.size);
      if (picture.format === "png") this.picture.add(picture.url, job.progress, true);
    }
    // The record is as old as its reading; the stream may know more of a running job.
    if (job.progress && (ended || job.progress.seconds >= (this.progress?.seconds ?? 0))) this.showProgress(job.progress);
    else this.showState();
    this.showPlan(job);
    this.showWarnings(job.warnings);
    if (before && before !== job.state) {
      announce(`${name}: ${stateName(job)}`);
      this.drawChart();
    }
    this.hears.onChange(job);
  }

  showProgress(progress) {
    this.progress = progress;
    setText(this.figures.get("error"), percent(progress.estimated_error));
    setText(this.bounds, boundsText(progress.error_bounds));
    setText(this.figures.get("iterations"), count(progress.iterations));
    setText(this.figures.get("shots"), count(progress.shots));
    setText(this.figures.get("ratio"), percent(progress.light_source_selection_ratio));
    setText(this.figures.get("time"), seconds(progress.seconds));
    this.showState();
  }

  showState() {
    const { job, progress } = this;
    const ended = isTerminal(job.state);
    const share = job.state === "succeeded" ? 1 : (progress?.fraction ?? 0);
    setText(this.figures.get("left"), ended ? NONE : seconds(progress?.seconds_remaining));
    setVariable(this.bar, "--share", share);
    setAttribute(this.bar, "data-state", job.state);
    setAttribute(this.bar, "aria-valuenow", Math.round(100 * share));
    setText(this.progressText, progressText(job, progress));
    for (const key of ["error", "iterations", "shots", "ratio", "time"]) {
      const value = this.figures.get(key);
      if (!value.textContent) setText(value, NONE);
    }
  }

  showPlan(job) {
    const { plan, stats } = job;
    const key = JSON.stringify([plan, stats?.seconds_total]);
    if (key === this.shownPlan) return;
    this.shownPlan = key;
    if (!plan) {
      this.plan.replaceChildren(h("p", { class: "hint" }, "Made when the job starts."));
      return;
    }
    const rows = [
      ["Method", plan.method],
      ["Patches", count(plan.patches)],
      ["Triangles", count(plan.triangles)],
      ...(stats ? [["Total time", seconds(stats.seconds_total)]] : []),
      ...(stats?.device ? [["Computed by", stats.device]] : []),
    ];
    const settings = Object.entries(plan.settings).map(([name, value]) => [words(name), /^\d+$/.test(value) ? count(Number(value)) : value]);
    this.plan.replaceChildren(
      h("ul", { class: "reasons" }, plan.reasons.map((reason) => h("li", {}, reason))),
      table(rows),
      ...(settings.length ? [h("h4", {}, "Settings in force"), table(settings)] : []));
  }

  showWarnings(warnings) {
    const key = JSON.stringify(warnings);
    if (key === this.shownWarnings) return;
    this.shownWarnings = key;
    this.warnings.hidden = warnings.length === 0;
    this.warnings.replaceChildren(
      h("div", { class: "card-head" }, h("h3", {}, "Not shown as authored"), h("span", { class: "hint" }, `${warnings.length}`)),
      h("ul", { class: "card-body warnings" }, warnings.map(({ at, what }) => h("li", {}, h("code", {}, at), " ", what))));
  }

  /** Makes a download possible once there is a file. */
  offer(format, size) {
    const link = this.downloads[format];
    setAttribute(link, "href", `/v1/jobs/${this.id}/image.${format}`);
    setAttribute(link, "download", `hemilux-${shortId(this.id)}.${format}`);
    setAttribute(link, "aria-disabled", null);
    setAttribute(link, "title", `Newest picture, ${bytes(size)}`);
  }

  async cancel() {
    this.cancelButton.disabled = true;
    try {
      this.update(await api.cancel(this.id));
    } catch (problem) {
      this.cancelButton.disabled = false;
      this.complain("The job could not be cancelled", problem);
    }
  }

  askToDelete() {
    const dialog = h("dialog", { class: "dialog", "aria-labelledby": "delete-title" },
      h("h2", { id: "delete-title" }, "Delete this job?"),
      h("p", {}, h("strong", {}, this.nameOf(this.job)), " and its pictures will be gone for good.",
        isTerminal(this.job.state) ? "" : " It has not ended yet; deleting ends it."),
      h("div", { class: "actions" },
        h("button", { type: "button", class: "button", autofocus: true, on: { click: () => dialog.close() } }, "Keep"),
        h("button", { type: "button", class: "button danger solid", on: { click: () => { dialog.close(); this.remove(); } } }, "Delete")));
    dialog.addEventListener("close", () => dialog.remove());
    document.body.append(dialog);
    dialog.showModal();
  }

  async remove() {
    try {
      await api.remove(this.id);
      this.close();
      announce("Job deleted");
      this.hears.onDeleted();
    } catch (problem) {
      this.complain("The job could not be deleted", problem);
    }
  }

  complain(what, problem) {
    this.notice.hidden = false;
    this.notice.replaceChildren(h("strong", {}, `${what}: `), problem.message);
    announce(`${what}: ${problem.message}`);
  }

  close() {
    this.closed = true;
    clearInterval(this.timer);
    this.follower.close();
    this.chart.close();
    this.picture.close();
  }
}

const download = (name) => h("a", { class: "button", "aria-disabled": "true", title: "No picture in this format yet" }, icon("download"), name);

/** Sky and sun in words. */
function surroundings({ sky, sun, sun_at: at, light_radius: radius }) {
  const words = { none: "no sky", studio: "studio" };
  const unnamed = at ? "clear sky" : "no sky";
  const skyText = Array.isArray(sky) ? `sky of radiance ${sky.join(", ")}` : sky?.environment ? `map ${sky.environment.slice(0, 16)}…` : words[sky] ?? sky ?? unnamed;
  const soft = radius ? `, lights of a radius of ${radius} m` : "";
  if (at) return `${skyText}, the sun at ${at.latitude}°, ${at.longitude}° on ${at.time}${soft}`;
  return `${skyText}${sun ? ", a sun" : ""}${soft}`;
}

const table = (rows) => h("dl", { class: "table" }, rows.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))));

/** The request without what was left at its default. */
function trimmed(request) {
  const kept = Object.entries(request).filter(([, value]) => value !== null && value !== 0 && !(typeof value === "object" && Object.keys(value).length === 0));
  return Object.fromEntries(kept);
}

function placeholder(job) {
  switch (job.state) {
    case "queued": return "Waiting for a device";
    case "running": return job.request.snapshots ? "The first picture is on its way" : "This job asked for no snapshots; its picture comes at the end";
    default: return "There is no picture";
  }
}

function progressText(job, progress) {
  if (job.state === "queued") return "Waiting for a device";
  if (job.state === "succeeded") return `Done: ${stopReason(job.stats?.stopped ?? "")}`;
  if (job.state === "failed") return "Failed";
  if (job.state === "cancelled") return job.result ? "Cancelled; the picture so far is kept" : "Cancelled before it started";
  if (!progress) return "Reading the scene";
  return `${Math.floor(100 * progress.fraction)}\u00a0% of the work done`;
}
