// Web pages that are not the server's own, in a real browser, against a server without API keys: a
// page on another port of this machine, and a page under a name that leads to the server's address.
// HEMILUX: the program. CHROMIUM: the browser.

import assert from "node:assert/strict";
import { once } from "node:events";
import { mkdtemp, rm } from "node:fs/promises";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";
import { Server } from "./server.js";

const ROOT = resolve(fileURLToPath(import.meta.url), "../../..");
const HEMILUX = process.env.HEMILUX ?? join(ROOT, "target/release/hemilux");
const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";
const REBOUND = "rebound.example";
const FLAGS = [
  "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync", `--host-resolver-rules=MAP ${REBOUND} 127.0.0.1`,
];
const PAGE = "<!doctype html><meta charset=utf-8><title>elsewhere</title><iframe name=target></iframe>";
const JOB = { scene: "cornell", method: "stochastic", width: 8, height: 8, max_iterations: 1, options: { patches: 200 } };

let scratch;
let context;
let elsewhere;
/** The origin of the page on another port. */
let origin;
const servers = [];

async function serve(...more) {
  const server = new Server(HEMILUX, join(scratch, `data-${servers.length}`));
  server.more = more;
  servers.push(server);
  await server.start();
  return server;
}

/** How many jobs and scenes there are. */
async function stored(server) {
  const count = async (path, name) => (await (await fetch(server.url + path)).json())[name].length;
  return (await count("/v1/jobs", "jobs")) + (await count("/v1/scenes", "scenes"));
}

/** In the page: what it can read at `base`; [] where that is nothing. */
async function read(base) {
  const found = [];
  const paths = ["/v1/jobs", "/v1/devices", "/openapi.yaml", "/metrics", "/", "/docs/"];
  for (const path of paths) {
    for (const mode of ["cors", "no-cors"]) {
      try {
        const response = await fetch(base + path, { mode });
        const text = await response.text();
        if (response.ok && text) found.push(`${mode} ${path}`);
      } catch { /* the browser or the server keeps it from the page */ }
    }
  }
  return found;
}

/** In the page: tries every way to make the server at `base` do something. */
async function act([base, job]) {
  const json = JSON.stringify(job);
  const form = () => {
    const data = new FormData();
    data.append("job", json);
    return data;
  };
  const ways = [
    { mode: "cors", headers: { "content-type": "application/json" }, body: json },
    { mode: "no-cors", headers: { "content-type": "text/plain" }, body: json },
    { mode: "no-cors", body: form() },
    { mode: "cors", body: form() },
    { mode: "no-cors", body: new URLSearchParams({ job: json }) },
  ];
  const answers = [];
  for (const way of ways) {
    const answer = await fetch(`${base}/v1/jobs`, { method: "POST", ...way }).catch(() => null);
    answers.push(answer?.status ?? 0);
  }
  navigator.sendBeacon(`${base}/v1/jobs`, form());
  await fetch(`${base}/v1/scenes`, { method: "POST", mode: "no-cors", body: new Blob(["{}"]) }).catch(() => null);
  // Forms as pages have them, into a frame.
  for (const enctype of ["multipart/form-data", "text/plain", "application/x-www-form-urlencoded"]) {
    const element = document.createElement("form");
    Object.assign(element, { method: "post", action: `${base}/v1/jobs`, target: "target", enctype });
    const field = document.createElement("input");
    // As text/plain, name=value reads as one JSON document.
    Object.assign(field, enctype === "text/plain" ? { name: `${json.slice(0, -1)},"labels":{"a":"`, value: '"}}' } : { name: "job", value: json });
    element.append(field);
    document.body.append(element);
    const loaded = new Promise((done) => { document.querySelector("iframe").addEventListener("load", done, { once: true }); });
    element.submit();
    await Promise.race([loaded, new Promise((done) => { setTimeout(done, 5000); })]);
  }
  return answers;
}

before(async () => {
  scratch = await mkdtemp(join(tmpdir(), "hemilux-foreign-"));
  elsewhere = createServer((_, response) => { response.setHeader("content-type", "text/html").end(PAGE); });
  elsewhere.listen(0, "127.0.0.1");
  await once(elsewhere, "listening");
  origin = `http://localhost:${elsewhere.address().port}`;
  context = await chromium.launchPersistentContext(join(scratch, "profile"), { executablePath: CHROMIUM, args: FLAGS });
});

after(async () => {
  await context?.close();
  for (const server of servers) await server.stop();
  elsewhere?.close();
  if (scratch) await rm(scratch, { recursive: true, force: true });
});

test("a page on another port of this machine neither reads nor acts", async () => {
  const server = await serve();
  const page = await context.newPage();
  await page.goto(origin);
  for (const host of ["localhost", "127.0.0.1"]) {
    const base = `http://${host}:${new URL(server.url).port}`;
    assert.deepEqual(await page.evaluate(read, base), [], host);
    const answers = await page.evaluate(act, [base, JOB]);
    assert.ok(answers.every((status) => status === 0 || status === 403), `${host}: ${answers}`);
  }
  assert.equal(await stored(server), 0);
  await page.close();
});

test("an invited page does, so the attempts above are real ones", async () => {
  const server = await serve("--cors-origin", origin);
  const page = await context.newPage();
  await page.goto(origin);
  assert.ok((await page.evaluate(read, server.url)).includes("cors /v1/jobs"));
  const answers = await page.evaluate(act, [server.url, JOB]);
  assert.equal(answers[0], 202);
  assert.equal(answers[3], 202);
  assert.ok(await stored(server) >= 3);
  await page.close();
});

/** A page of the server's own port under the attacker's name. What it shows does not matter: the scripts are these tests'. */
async function reboundPage(server) {
  const base = `http://${REBOUND}:${new URL(server.url).port}`;
  const page = await context.newPage();
  assert.equal((await page.goto(`${base}/livez`)).status(), 200);
  assert.equal(await page.evaluate(() => location.origin), base);
  await page.evaluate((html) => { document.documentElement.innerHTML = html; }, PAGE);
  return [page, base];
}

test("a page under a rebound name neither reads nor acts", async () => {
  for (const more of [[], ["--allow-remote"]]) {
    const server = await serve(...more);
    const [page, base] = await reboundPage(server);
    assert.deepEqual(await page.evaluate(read, base), []);
    const answers = await page.evaluate(act, [base, JOB]);
    assert.ok(answers.every((status) => status === 403), `${answers}`);
    assert.equal((await page.goto(`${base}/`)).status(), 403);
    assert.equal(await stored(server), 0);
    await page.close();
  }
});

test("a name that is allowed does, so the name is what keeps the page out", async () => {
  const server = await serve("--allowed-host", REBOUND);
  const [page, base] = await reboundPage(server);
  assert.ok((await page.evaluate(read, base)).includes("cors /v1/jobs"));
  assert.equal((await page.evaluate(act, [base, JOB]))[0], 202);
  assert.ok(await stored(server) >= 3);
  await page.close();
});

test("with keys asked for, a rebound name does nothing and reads nothing under /v1", async () => {
  const server = await serve("--require-keys");
  const [page, base] = await reboundPage(server);
  const answers = await page.evaluate(act, [base, JOB]);
  assert.ok(answers.every((status) => status === 401), `${answers}`);
  assert.ok(!(await page.evaluate(read, base)).some((path) => path.includes("/v1/")));
  await page.close();
});
