// The server's API as the page uses it.

import * as key from "./key.js";

/** A failed request: a problem document; with status 0 the server was not reached at all. */
export class Problem extends Error {
  constructor(status, document) {
    super(document.detail || document.title || `The server answered ${status}.`);
    this.status = status;
    this.title = document.title ?? "";
    this.errors = document.errors ?? [];
  }
}

const unreachable = () => new Problem(0, { detail: "The server cannot be reached." });

function parse(text) {
  try {
    return JSON.parse(text) ?? {};
  } catch {
    return {};
  }
}

async function request(path, options = {}) {
  let response;
  let text;
  try {
    const headers = { ...key.headers(), ...options.headers };
    response = await fetch(path, { signal: AbortSignal.timeout(15_000), ...options, headers });
    text = await response.text();
  } catch {
    throw unreachable();
  }
  if (response.status === 401) dispatchEvent(new Event("keyneeded"));
  if (!response.ok) throw new Problem(response.status, parse(text));
  return { response, text };
}

const getJson = async (path) => JSON.parse((await request(path)).text);

/** What this server offers to a new job. */
export const about = () => getJson("/assets/server.json");

export const devices = async () => (await getJson("/v1/devices")).devices;

/** Jobs, newest first; `filter` may hold `state` and `label`. */
export function jobs(limit, filter = {}) {
  const query = new URLSearchParams({ limit });
  for (const name of ["state", "label"]) if (filter[name]) query.set(name, filter[name]);
  return getJson(`/v1/jobs?${query}`);
}

export const job = (id) => getJson(`/v1/jobs/${encodeURIComponent(id)}`);

export const trace = async (id) => (await getJson(`/v1/jobs/${encodeURIComponent(id)}/trace`)).points;

export const cancel = async (id) =>
  JSON.parse((await request(`/v1/jobs/${encodeURIComponent(id)}/cancel`, { method: "POST" })).text);

export const remove = (id) => request(`/v1/jobs/${encodeURIComponent(id)}`, { method: "DELETE" });

export const removeScene = (id) => request(`/v1/scenes/${encodeURIComponent(id)}`, { method: "DELETE" });

export const environments = async () => (await getJson("/v1/environments?limit=200")).environments;

export const scenes = async () => (await getJson("/v1/scenes?limit=200")).scenes;

/** Posts a job. The key makes sending the same again safe. */
export async function createJob(job, key) {
  const headers = { "content-type": "application/json", "idempotency-key": key };
  return JSON.parse((await request("/v1/jobs", { method: "POST", headers, body: JSON.stringify(job) })).text);
}

/** Jobs by state, from the metrics: the only place that counts them all. */
export async function counts() {
  const { text } = await request("/metrics");
  const found = {};
  for (const [, state, n] of text.matchAll(/^hemilux_jobs\{state="(\w+)"\} (\d+)/gm)) found[state] = Number(n);
  return found;
}

const isScene = (name) => /\.(glb|gltf|zip)$/i.test(name);

/** The file of a selection that is the scene; the others are what it refers to. */
export const mainFile = (files) => files.find((file) => isScene(file.name));

/** Whether a file is a map of a sky by its name. */
export const isSky = (file) => /\.(exr|hdr)$/i.test(file.name);

/** Uploads a scene; `onProgress` hears the share sent, in [0, 1]. */
export function uploadScene(files, onProgress) {
  const main = mainFile(files);
  const form = new FormData();
  form.append("scene", main, main.name);
  for (const file of files) {
    if (file !== main) form.append(file.webkitRelativePath || file.name, file, file.name);
  }
  // The name as it is: forms write quotes in file names in another way.
  return send(`/v1/scenes?name=${encodeURIComponent(main.name)}`, form, onProgress);
}

/** Uploads a map of a sky; `onProgress` hears the share sent, in [0, 1]. */
export function uploadEnvironment(file, onProgress) {
  const map = new Blob([file], { type: "application/octet-stream" });
  return send(`/v1/environments?name=${encodeURIComponent(file.name)}`, map, onProgress);
}

/** Posts a body. XMLHttpRequest, because fetch does not report how much was sent. */
function send(path, body, onProgress) {
  return new Promise((resolve, reject) => {
    const upload = new XMLHttpRequest();
    upload.open("POST", path);
    for (const [name, value] of Object.entries(key.headers())) upload.setRequestHeader(name, value);
    upload.upload.addEventListener("progress", (event) => {
      if (event.lengthComputable && event.total > 0) onProgress(event.loaded / event.total);
    });
    upload.addEventListener("load", () => {
      const answer = parse(upload.responseText);
      if (upload.status >= 200 && upload.status < 300) resolve(answer);
      else reject(new Problem(upload.status, answer));
    });
    upload.addEventListener("error", () => reject(unreachable()));
    upload.send(body);
  });
}

const shellQuoted = (text) => `'${text.replaceAll("'", `'\\''`)}'`;

/** The command line that posts this job. */
export function curlFor(job) {
  const body = shellQuoted(JSON.stringify(job));
  const auth = key.key() ? ` \\\n  -H "Authorization: Bearer $HEMILUX_KEY"` : "";
  return `curl ${location.origin}/v1/jobs \\\n  -H 'Content-Type: application/json'${auth} \\\n  -d ${body}`;
}
