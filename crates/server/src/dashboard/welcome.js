// What the page shows where no job is open: how to get the first picture.

import { copyButton, h, icon } from "./dom.js";

function command(title, text) {
  return h("figure", { class: "command" },
    h("figcaption", {}, h("span", {}, title), copyButton("Copy", () => text)),
    h("pre", { tabindex: "0" }, h("code", {}, text)));
}

/** `hasJobs` says whether there is anything to choose from. */
export function welcome(hasJobs) {
  const job = '{"width":512,"height":512,"time_budget_s":20,"snapshots":{"every_s":1}}';
  const post = `curl ${location.origin}/v1/jobs \\\n  -F scene=@scene.glb \\\n  -F job='${job}'`;
  return h("div", { class: "welcome" },
    h("img", { src: "/assets/icon.svg", alt: "", width: 56, height: 56 }),
    h("h2", {}, hasJobs ? "Choose a job, or start one" : "Render your first picture"),
    h("p", {}, "Hemilux computes how light spreads through a glTF scene and shows the picture while it gets better, with an estimate of the error that is left."),
    h("p", { class: "actions" }, h("a", { class: "button primary", href: "#/new" }, icon("plus"), "New job")),
    command("The same from a terminal", post),
    h("p", { class: "hint" }, "Every request is described under ", h("a", { href: "/docs/" }, "/docs"), "."));
}

/** Where a link names a job that is not there. */
export function goneNotice() {
  return h("div", { class: "welcome" },
    h("h2", {}, "This job is not there"),
    h("p", {}, "It was deleted, or the link belongs to another server."),
    h("p", { class: "actions" }, h("a", { class: "button", href: "#/" }, icon("back"), "All jobs")));
}
