// The picture of a job: the newest one as it comes, or an earlier one to look back at.

import { loadable } from "./key.js";
import { h, icon, setAttribute, setText, setVariable } from "./dom.js";
import { percent, pixels, seconds } from "./format.js";

/** Pictures that arrive together, as when a stream replays, are loaded only once. */
const SETTLE_MS = 80;

export class PictureView {
  /** `onShown(url)` hears of every picture that is on the screen. */
  constructor(width, height, onShown) {
    this.onShown = onShown;
    /** Oldest first: url, progress, isFinal. */
    this.pictures = [];
    this.followsNewest = true;
    this.image = h("img", { class: "picture-image", alt: "", hidden: true, width, height });
    setAttribute(this.image, "data-small", width < 400 && height < 400);
    this.placeholder = h("p", { class: "picture-placeholder" });
    this.frame = h("div", { class: "picture-frame" }, this.image, this.placeholder);
    setVariable(this.frame, "--ratio", `${width} / ${height}`);
    setVariable(this.frame, "--ratio-number", width / height);
    this.slider = h("input", { type: "range", min: 0, max: 0, value: 0, step: 1, "aria-label": "Snapshot", on: { input: () => this.choose() } });
    this.caption = h("span", { class: "picture-caption" });
    this.live = h("button", { type: "button", class: "button small quiet", on: { click: () => this.follow() } }, "Newest");
    this.link = h("a", { class: "button small quiet", target: "_blank", rel: "noopener" }, icon("open"), "Full size");
    this.controls = h("div", { class: "picture-controls", hidden: true }, this.slider, h("div", { class: "picture-line" }, this.caption, this.live, this.link));
    this.root = h("div", { class: "picture" }, this.frame, this.controls);
    this.size = pixels(width, height);
  }

  /** What stands in the frame while there is no picture. */
  setPlaceholder(text) {
    setText(this.placeholder, text);
  }

  add(url, progress, isFinal = false) {
    const known = this.pictures.find((picture) => picture.url === url);
    // The final picture may be known before a replay brings the earlier ones.
    const end = this.pictures.at(-1)?.isFinal && !isFinal ? this.pictures.length - 1 : this.pictures.length;
    if (known) known.isFinal ||= isFinal;
    else this.pictures.splice(end, 0, { url, progress, isFinal });
    setAttribute(this.slider, "max", this.pictures.length - 1);
    this.controls.hidden = false;
    if (this.followsNewest) this.follow();
    else this.describe();
  }

  follow() {
    this.followsNewest = true;
    this.slider.value = this.pictures.length - 1;
    this.load();
  }

  choose() {
    this.followsNewest = Number(this.slider.value) === this.pictures.length - 1;
    this.load();
  }

  get chosen() {
    return this.pictures[Number(this.slider.value)];
  }

  describe() {
    const index = Number(this.slider.value);
    const { progress, isFinal, url } = this.chosen;
    const name = isFinal ? "Final picture" : `Snapshot ${index + 1} of ${this.pictures.length}`;
    const figures = progress ? [seconds(progress.seconds), percent(progress.estimated_error)] : [];
    const text = [name, ...figures].join(" · ");
    setText(this.caption, text);
    setAttribute(this.slider, "aria-valuetext", text);
    this.slider.disabled = this.pictures.length < 2;
    this.live.disabled = this.followsNewest;
    setAttribute(this.link, "href", url);
    setAttribute(this.image, "alt", `${name}, ${this.size}`);
  }

  load() {
    this.describe();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.swap(this.chosen.url), this.image.hidden ? 0 : SETTLE_MS);
  }

  /** Shows a picture once it is decoded, so that the one before stays until then. */
  async swap(url) {
    if (this.shown === url) return;
    this.wanted = url;
    const loaded = new Image();
    try {
      loaded.src = await loadable(url);
      await loaded.decode();
    } catch {
      // Gone with its job, or the connection is; the next picture tries again.
      return;
    }
    if (this.wanted !== url) return;
    this.shown = url;
    this.image.src = loaded.src;
    this.image.hidden = false;
    this.placeholder.hidden = true;
    this.onShown(url);
  }

  close() {
    clearTimeout(this.timer);
    this.wanted = null;
  }
}
