// A real server for the tests: own port, own data folder, ended by its process id.

import { execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { readFile } from "node:fs/promises";
import { createInterface } from "node:readline";

const START_MS = 20_000;

export class Server {
  constructor(binary, dataDir) {
    this.binary = binary;
    this.dataDir = dataDir;
    this.listen = "127.0.0.1:0";
    this.key = "";
    /** Further arguments. */
    this.more = [];
  }

  /** Makes an API key and uses it from now on. */
  addKey(name) {
    const args = ["keys", "--data-dir", this.dataDir, "add", name];
    this.key = execFileSync(this.binary, args, { encoding: "utf8", stdio: ["ignore", "pipe", "ignore"] }).trim();
    return this.key;
  }

  /** Starts; again on the port that it had before, so that an open page finds it. */
  async start() {
    const args = ["serve", "--listen", this.listen, "--data-dir", this.dataDir, "--devices", "cpu", ...this.more];
    this.child = spawn(this.binary, args, { stdio: ["ignore", "pipe", "pipe"] });
    this.log = "";
    this.child.stderr.on("data", (chunk) => { this.log += chunk; });
    const lines = createInterface({ input: this.child.stdout });
    const line = once(lines, "line", { signal: AbortSignal.timeout(START_MS) }).then(([text]) => text);
    const ended = once(this.child, "exit").then(([code]) => Promise.reject(new Error(`the server ended with ${code}:\n${this.log}`)));
    ended.catch(() => {});
    this.url = (await Promise.race([line, ended])).trim();
    this.listen = new URL(this.url).host;
  }

  async stop() {
    if (!this.child || this.child.exitCode !== null || this.child.signalCode !== null) return;
    const exit = once(this.child, "exit");
    this.child.kill("SIGTERM");
    await exit;
  }

  async #json(path, options) {
    const auth = this.key ? { authorization: `Bearer ${this.key}` } : {};
    const response = await fetch(this.url + path, { ...options, headers: { ...auth, ...options?.headers } });
    const text = await response.text();
    if (!response.ok) throw new Error(`${path}: ${response.status} ${text}`);
    return text ? JSON.parse(text) : null;
  }

  async upload(path) {
    const headers = { "content-type": "model/gltf-binary" };
    return this.#json("/v1/scenes", { method: "POST", headers, body: await readFile(path) });
  }

  post(job) {
    const headers = { "content-type": "application/json" };
    return this.#json("/v1/jobs", { method: "POST", headers, body: JSON.stringify(job) });
  }

  job(id, waitSeconds = 0) {
    return this.#json(`/v1/jobs/${id}?wait=${waitSeconds}`);
  }

  cancel(id) {
    return this.#json(`/v1/jobs/${id}/cancel`, { method: "POST" });
  }
}
