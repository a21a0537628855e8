// Estimated error against time, both axes logarithmic: a straight line down means steady progress.

import { h, setAttribute, setText, svg } from "./dom.js";
import { count, percent, seconds } from "./format.js";

const MARGIN = { left: 52, right: 12, top: 10, bottom: 26 };
const HEIGHT = 210;
const MAX_DRAWN = 600;

/** Round values 1, 2, 5 × 10^k in the range; powers of ten alone where that would be many. */
function ticks(low, high, most) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power += 1) {
    for (const digit of [1, 2, 5]) {
      const value = digit * 10 ** power;
      if (value >= low * 0.999 && value <= high * 1.001) found.push({ value, digit });
    }
  }
  return found.length > most ? found.filter(({ digit }) => digit === 1) : found;
}

const tickPercent = (share) => `${Number((100 * share).toPrecision(2))} %`;
const tickSeconds = (s) => (s < 60 ? `${Number(s.toPrecision(2))} s` : seconds(s));

export class ErrorChart {
  constructor() {
    this.points = [];
    this.target = null;
    this.width = 400;
    this.canvas = svg("svg", { class: "chart-canvas", role: "img", height: HEIGHT });
    this.readout = h("p", { class: "chart-readout", "aria-hidden": "true" });
    this.root = h("div", { class: "chart" }, this.canvas, this.readout);
    this.canvas.addEventListener("pointermove", (event) => this.point(event.offsetX));
    this.canvas.addEventListener("pointerleave", () => this.point(null));
    this.observer = new ResizeObserver(([entry]) => {
      this.width = Math.max(200, Math.round(entry.contentRect.width));
      this.draw();
    });
    this.observer.observe(this.root);
  }

  /**
   * Points have `seconds`, `estimated_error` (or null) and `iterations`; `target` may be null;
   * `ended` says that no more will come.
   */
  show(points, target, ended) {
    this.ended = ended;
    this.points = points.filter((point) => point.estimated_error > 0 && point.seconds > 0);
    this.target = target;
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      this.draw();
    });
  }

  draw() {
    const { points, target, width } = this;
    setAttribute(this.canvas, "width", width);
    setAttribute(this.canvas, "viewBox", `0 0 ${width} ${HEIGHT}`);
    if (points.length < 2) {
      this.scale = null;
      const text = svg("text", { class: "chart-empty", x: width / 2, y: HEIGHT / 2, "text-anchor": "middle" }, this.ended ? "There were too few estimates" : "Appears with the first estimates");
      this.canvas.replaceChildren(text);
      setAttribute(this.canvas, "aria-label", "Estimated error against time: no estimates yet");
      setText(this.readout, "\u00a0");
      return;
    }
    const errors = points.map((point) => point.estimated_error);
    const lowest = Math.min(...errors, target ?? Infinity);
    const times = [points[0].seconds, points.at(-1).seconds];
    const scale = {
      t: [times[0], Math.max(times[1], times[0] * 2)],
      e: [lowest / 1.25, Math.max(...errors, lowest * 2) * 1.15],
    };
    const place = (value, [low, high], from, to) => from + ((Math.log(value) - Math.log(low)) / (Math.log(high) - Math.log(low))) * (to - from);
    scale.x = (s) => place(s, scale.t, MARGIN.left, width - MARGIN.right);
    scale.y = (e) => place(e, scale.e, HEIGHT - MARGIN.bottom, MARGIN.top);
    this.scale = scale;
    const right = width - MARGIN.right;
    const bottom = HEIGHT - MARGIN.bottom;

    const grid = svg("g", { class: "chart-grid" });
    for (const { value } of ticks(...scale.e, 8)) {
      const y = scale.y(value);
      grid.append(svg("line", { x1: MARGIN.left, x2: right, y1: y, y2: y }), svg("text", { x: MARGIN.left - 8, y: y + 4, "text-anchor": "end" }, tickPercent(value)));
    }
    for (const { value } of ticks(...scale.t, width / 60)) {
      const x = scale.x(value);
      const anchor = x > right - 16 ? "end" : x < MARGIN.left + 12 ? "start" : "middle";
      grid.append(svg("line", { x1: x, x2: x, y1: MARGIN.top, y2: bottom }), svg("text", { x, y: bottom + 17, "text-anchor": anchor }, tickSeconds(value)));
    }
    const step = Math.ceil(points.length / MAX_DRAWN);
    const drawn = points.filter((_, index) => index % step === 0 || index === points.length - 1);
    const line = drawn.map((point) => `${scale.x(point.seconds).toFixed(1)},${scale.y(point.estimated_error).toFixed(1)}`).join(" ");
    const last = points.at(-1);
    this.marker = svg("circle", { class: "chart-marker", r: 4 });
    this.canvas.replaceChildren(
      grid,
      ...(target ? [svg("line", { class: "chart-target", x1: MARGIN.left, x2: right, y1: scale.y(target), y2: scale.y(target) })] : []),
      svg("polyline", { class: "chart-line", points: line }),
      this.marker,
    );
    this.point(this.pointed ?? null);
    const goal = target ? `; the target is ${percent(target)}` : "";
    setAttribute(this.canvas, "aria-label",
      `Estimated error against time: from ${percent(points[0].estimated_error)} at ${seconds(points[0].seconds)} to ${percent(last.estimated_error)} at ${seconds(last.seconds)}${goal}`);
  }

  /** Reads the chart at a horizontal position; `null` is the newest point. */
  point(x) {
    this.pointed = x;
    if (!this.scale) return;
    const { scale, points } = this;
    const distance = (point) => Math.abs(scale.x(point.seconds) - x);
    const nearest = x === null ? points.at(-1) : points.reduce((best, point) => (distance(point) < distance(best) ? point : best));
    setAttribute(this.marker, "cx", scale.x(nearest.seconds));
    setAttribute(this.marker, "cy", scale.y(nearest.estimated_error));
    setText(this.readout, `${percent(nearest.estimated_error)} after ${seconds(nearest.seconds)}, ${count(nearest.iterations)} iterations`);
  }

  close() {
    this.observer.disconnect();
    cancelAnimationFrame(this.frame);
  }
}
