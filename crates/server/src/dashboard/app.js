// The page as a whole: routes, refreshing, the connection.

import * as api from "./api.js";
import { announce, h, icon, setText } from "./dom.js";
import { clock, isTerminal, shortHash } from "./format.js";
import { JobForm } from "./form.js";
import { Header } from "./header.js";
import { JobView } from "./job.js";
import { askForKey, followLink } from "./key.js";
import { JobList } from "./list.js";
import { goneNotice, welcome } from "./welcome.js";

const PAGE = 50;
/** The most that the server lists at once. */
const MAX_LISTED = 200;
const BUSY_MS = 1000;
const QUIET_MS = 4000;
const LAST_RETRY_MS = 10_000;

const pane = document.getElementById("pane");
const offline = document.getElementById("offline");

const header = new Header(document.getElementById("header"));
const list = new JobList(document.getElementById("list"), nameOf, {
  onFilter: () => {
    limit = PAGE;
    refresh();
  },
  onMore: () => {
    limit = Math.min(limit + PAGE, MAX_LISTED);
    refresh();
  },
});

/** Jobs as last listed, newest first. */
let jobs = [];
let limit = PAGE;
/** The open JobView or JobForm, if any. */
let open = null;
let failures = 0;
let lastContact = null;
let streamAlive = true;
let timer = 0;
let refreshes = 0;

/** A job's title: the label `name`, its scene's name, or the beginning of its scene's hash. */
function nameOf(job) {
  return job.request.labels.name || job.scene_name || `Scene ${shortHash(job.scene)}`;
}

function setConnection() {
  const lost = failures > 0 || !streamAlive;
  offline.hidden = !lost;
  if (!lost) return;
  const since = lastContact ? ` What you see is from ${clock(lastContact)}.` : "";
  setText(offline, `Connection to the server lost; trying again.${since}`);
}

/** Reads what the list and the head show, then plans the next reading. */
async function refresh() {
  clearTimeout(timer);
  refreshes += 1;
  const mine = refreshes;
  try {
    const [page, counts, devices] = await Promise.all([api.jobs(limit, list.filter), api.counts(), api.devices()]);
    if (mine !== refreshes) return;
    const hadJobs = jobs.length > 0;
    jobs = page.jobs;
    document.body.toggleAttribute("data-has-jobs", Object.values(counts).some((n) => n > 0));
    list.show(jobs, page.next_cursor !== null && limit < MAX_LISTED);
    list.setCounts(counts);
    header.setCounts(counts);
    header.setDevices(devices);
    failures = 0;
    lastContact = Date.now();
    document.body.dataset.ready = "true";
    if (route().name === "home" && hadJobs !== jobs.length > 0) showHome();
    const busy = (counts.running ?? 0) + (counts.queued ?? 0) > 0;
    plan(busy ? BUSY_MS : QUIET_MS);
  } catch (problem) {
    if (mine !== refreshes) return;
    failures += 1;
    plan(Math.min(BUSY_MS * 2 ** (failures - 1), LAST_RETRY_MS));
    if (!(problem instanceof api.Problem)) throw problem;
  } finally {
    if (mine === refreshes) setConnection();
  }
}

function plan(ms) {
  clearTimeout(timer);
  // A page that nobody looks at asks nothing; it asks when it is looked at again.
  if (!document.hidden) timer = setTimeout(refresh, ms);
}

function route() {
  const [, name, id] = location.hash.split("/");
  if (name === "new") return { name: "new" };
  if (name === "jobs" && id) return { name: "job", id };
  return { name: "home" };
}

function closeOpen() {
  open?.close();
  open = null;
  streamAlive = true;
  document.title = "Hemilux";
}

function showHome() {
  pane.replaceChildren(welcome(jobs.length > 0));
}

function showGone() {
  closeOpen();
  pane.replaceChildren(goneNotice());
  refresh();
}

async function showJob(id) {
  let job = jobs.find((known) => known.id === id);
  if (!job) {
    pane.replaceChildren(h("p", { class: "hint loading" }, "Loading…"));
    try {
      job = await api.job(id);
    } catch (problem) {
      if (route().id !== id) return;
      if (problem.status === 404) showGone();
      else showTrouble(problem, () => showRoute());
      return;
    }
    if (route().id !== id) return;
  }
  const view = new JobView(job, nameOf, {
    onChange: (changed) => {
      const at = jobs.findIndex((known) => known.id === changed.id);
      const ended = at >= 0 && isTerminal(changed.state) && !isTerminal(jobs[at].state);
      if (ended) refresh();
    },
    onPicture: (shown, url) => list.setPicture(shown, url),
    onConnection: (alive) => {
      streamAlive = alive;
      setConnection();
      // The list has the shorter patience: it finds out whether the server is there.
      if (!alive) refresh();
    },
    onGone: showGone,
    onDeleted: () => {
      location.hash = "#/";
      refresh();
    },
    onLabel: (label) => list.setFilter({ label, state: "" }),
  });
  open = view;
  pane.replaceChildren(view.root);
}

function showTrouble(problem, retry) {
  pane.replaceChildren(h("div", { class: "welcome" },
    h("h2", {}, "This did not work"),
    h("p", {}, problem.message),
    h("p", { class: "actions" }, h("button", { type: "button", class: "button", on: { click: retry } }, "Try again"))));
}

function showForm() {
  const nameOfScene = (id) => jobs.find((job) => job.scene === id && job.request.labels.name)?.request.labels.name;
  open = new JobForm(nameOfScene, (job) => {
    announce("Job accepted");
    location.hash = `#/jobs/${job.id}`;
    refresh();
  });
  pane.replaceChildren(h("a", { class: "button small quiet back", href: "#/" }, icon("back"), "All jobs"), open.root);
  open.focus();
}

function showRoute() {
  closeOpen();
  const { name, id } = route();
  document.body.dataset.route = name;
  list.setSelected(id);
  pane.scrollTop = 0;
  scrollTo(0, 0);
  if (name === "job") showJob(id);
  else if (name === "new") showForm();
  else showHome();
}

// The fragment is the route, so a skip link cannot be an ordinary one.
document.querySelector(".skip").addEventListener("click", (event) => {
  event.preventDefault();
  pane.focus();
});
addEventListener("hashchange", showRoute);
document.addEventListener("visibilitychange", () => {
  if (!document.hidden) refresh();
});
addEventListener("online", refresh);
addEventListener("keyneeded", () => askForKey(() => {
  showRoute();
  refresh();
}));
document.addEventListener("click", followLink);

showRoute();
refresh();
