// The head of the page: devices, queue, links.

import { h, icon, setAttribute, setText } from "./dom.js";
import { count } from "./format.js";

export class Header {
  constructor(root) {
    this.devices = h("ul", { class: "devices", "aria-label": "Devices" });
    this.running = h("span", { class: "number" }, "–");
    this.queued = h("span", { class: "number" }, "–");
    this.chips = new Map();
    root.append(
      h("a", { class: "brand", href: "#/" }, h("img", { src: "/assets/icon.svg", alt: "", width: 28, height: 28 }), h("span", {}, "Hemilux")),
      this.devices,
      h("p", { class: "queue", title: "Jobs that run and jobs that wait" },
        h("span", {}, this.running, " running"), h("span", {}, this.queued, " waiting")),
      h("nav", { class: "links", "aria-label": "API" },
        h("a", { href: "/docs/" }, "API"),
        h("a", { href: "/openapi.yaml" }, "OpenAPI"),
        h("a", { href: "/metrics" }, "Metrics")),
      h("a", { class: "button primary", href: "#/new" }, icon("plus"), "New job"),
    );
  }

  setCounts(counts) {
    setText(this.running, count(counts.running ?? 0));
    setText(this.queued, count(counts.queued ?? 0));
  }

  setDevices(devices) {
    const pool = devices.filter((device) => device.in_pool);
    const ids = new Set(pool.map((device) => device.id));
    for (const [id, chip] of this.chips) {
      if (!ids.has(id)) {
        chip.root.remove();
        this.chips.delete(id);
      }
    }
    for (const device of pool) {
      if (!this.chips.has(device.id)) this.chips.set(device.id, this.newChip());
      const chip = this.chips.get(device.id);
      setAttribute(chip.root, "data-status", device.status);
      setText(chip.name, device.id);
      setText(chip.status, device.status);
      setAttribute(chip.link, "href", device.job ? `#/jobs/${device.job}` : null);
      setAttribute(chip.link, "title", [device.name, device.driver, device.error].filter(Boolean).join(" · "));
    }
  }

  newChip() {
    const chip = { name: h("strong"), status: h("span", { class: "device-status" }) };
    chip.link = h("a", { class: "device" }, h("span", { class: "dot", "aria-hidden": "true" }), chip.name, chip.status);
    chip.root = h("li", {}, chip.link);
    this.devices.append(chip.root);
    return chip;
  }
}
