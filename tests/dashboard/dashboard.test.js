// The dashboard as a user has it: a real browser, a real server, real renders.
// HEMILUX: the program. CHROMIUM: the browser. OUT: folder for screenshots.

import assert from "node:assert/strict";
import { mkdir, mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";
import { distancesToLast, nameless, overflowing, poorContrast, watchLayout } from "./checks.js";
import { Server } from "./server.js";

const ROOT = resolve(fileURLToPath(import.meta.url), "../../..");
const HEMILUX = process.env.HEMILUX ?? join(ROOT, "target/release/hemilux");
const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";
const OUT = resolve(process.env.OUT ?? join(ROOT, "out/dashboard"));
const FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];
const HOSTILE = '<img src=x onerror="window.pwned=1">';
const WIDE = { width: 1440, height: 1000 };
const NARROW = { width: 360, height: 780 };

let scratch;
let server;
let context;
let page;
/** What the console said in anger, and what the policy refused. */
const complaints = [];
/** Complaints that the present step provokes on purpose. */
let expected = [];

const scene = (name) => join(ROOT, "scenes", `${name}.glb`);
const text = (selector) => page.locator(selector).innerText();
const figure = (key) => text(`.figure-${key} dd:not(.figure-note)`);
const shot = (name, options = {}) => page.screenshot({ path: join(OUT, `${name}.png`), ...options });

async function go(route) {
  await page.evaluate((hash) => { location.hash = hash; }, route);
}

async function until(what, condition, limitMs = 20_000) {
  const deadline = Date.now() + limitMs;
  for (;;) {
    const value = await condition();
    if (value) return value;
    assert.ok(Date.now() < deadline, `${what} did not happen within ${limitMs / 1000} s`);
    await new Promise((done) => { setTimeout(done, 100); });
  }
}

const state = (name) => until(`state ${name}`, async () => (await text(".job-title-line .pill")) === name, 30_000);

before(async () => {
  await mkdir(OUT, { recursive: true });
  scratch = await mkdtemp(join(tmpdir(), "hemilux-dashboard-"));
  server = new Server(HEMILUX, join(scratch, "data"));
  await server.start();
  context = await chromium.launchPersistentContext(join(scratch, "profile"), {
    executablePath: CHROMIUM, args: FLAGS, viewport: WIDE, colorScheme: "light",
  });
  page = context.pages()[0] ?? (await context.newPage());
  page.setDefaultTimeout(15_000);
  page.on("console", (message) => {
    if (message.type() !== "error" && message.type() !== "warning") return;
    const line = `${message.text()} (${message.location().url})`;
    if (!expected.some((pattern) => pattern.test(line))) complaints.push(line);
  });
  page.on("pageerror", (error) => complaints.push(String(error.stack)));
  await page.exposeFunction("reportViolation", (line) => complaints.push(line));
  await page.addInitScript(() => {
    document.addEventListener("securitypolicyviolation", (event) => window.reportViolation(`policy: ${event.violatedDirective} ${event.blockedURI}`));
  });
});

after(async () => {
  await context?.close();
  await server?.stop();
  if (scratch) await rm(scratch, { recursive: true, force: true });
});

test("an empty server explains how to get the first picture", async () => {
  const answer = await page.goto(server.url);
  assert.match(answer.headers()["content-security-policy"], /default-src 'none'.*script-src 'self'/);
  assert.doesNotMatch(answer.headers()["content-security-policy"], /unsafe/);
  await page.waitForSelector("body[data-ready]");
  assert.ok((await text(".command pre")).startsWith(`curl ${server.url}/v1/jobs`));
  assert.equal(await text(".list-empty"), "No jobs yet.");
  assert.match(await text(".devices"), /cpu\s+idle/);
  await shot("empty");
});

test("the form shows the server's objections at their fields", async () => {
  await page.getByRole("link", { name: "New job" }).first().click();
  const bytes = await readFile(scene("cornell"));
  await page.setInputFiles("#files", { name: "broken.glb", mimeType: "model/gltf-binary", buffer: bytes.subarray(0, 400) });
  expected = [/422.*\/v1\/(scenes|jobs)/];
  await page.waitForSelector("#scene-error:not([hidden])");
  assert.notEqual(await text("#scene-error"), "");

  await page.setInputFiles("#files", { name: `${HOSTILE}.glb`, mimeType: "model/gltf-binary", buffer: bytes });
  await until("the upload", async () => (await text(".drop")).includes("is stored"));
  assert.equal(await page.inputValue("#name"), HOSTILE);
  assert.match(await text(".scene-facts"), /46 triangles/);

  await page.fill("#width", "0");
  await page.fill("#target_error", "100");
  await page.getByRole("button", { name: "Start job" }).click();
  assert.match(await text("#target_error-error"), /below 100 %/);
  await page.fill("#target_error", "");
  await page.getByRole("button", { name: "Start job" }).click();
  await page.waitForSelector("#width-error:not([hidden])");
  assert.match(await text("#width-error"), /must be between 1 and/);
  assert.equal(await page.evaluate(() => document.activeElement.id), "width");
  await shot("form");
  expected = [];
});

test("a map of a sky is stored, chosen and sent", async () => {
  const map = Buffer.concat([Buffer.from("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n"), Buffer.alloc(32, 128)]);
  const send = (name, buffer) => page.setInputFiles("#files", { name, mimeType: "image/vnd.radiance", buffer });
  expected = [/422.*\/v1\/(environments|jobs)/];
  await send("broken.hdr", map.subarray(0, 20));
  await page.waitForSelector("#environment-error:not([hidden])");
  await send("grey.hdr", map);
  await until("the upload", async () => (await text(".drop")).includes("chosen as the sky"));
  const id = await page.inputValue("#environment");
  assert.match(id, /^[0-9a-f]{64}$/);
  assert.match(await text("#environment optgroup"), /grey\.hdr \(4 × 2\)/);
  const sent = async () => {
    const [request] = await Promise.all([
      page.waitForRequest((one) => one.method() === "POST" && one.url().endsWith("/v1/jobs")),
      page.getByRole("button", { name: "Start job" }).click(),
    ]);
    return request.postDataJSON();
  };
  const plain = await sent();
  assert.deepEqual([plain.environment, plain.background, plain.units], [{ sky: { environment: id } }, undefined, undefined]);
  await page.selectOption("#background", "white");
  assert.deepEqual((await sent()).background, [1, 1, 1]);
  await page.selectOption("#background", "transparent");
  await page.selectOption("#units", "radiometric");
  const other = await sent();
  assert.deepEqual([other.background, other.units], ["transparent", "radiometric"]);
  await page.waitForSelector("#width-error:not([hidden])");
  for (const field of ["environment", "background", "units"]) await page.selectOption(`#${field}`, "");
  await page.locator(".more-fields summary").click();
  expected = [];
});

test("a method shows its settings, and only it gets them", async () => {
  await page.locator(".more-fields summary").click();
  assert.match(await text(".more-fields fieldset"), /auto picks a method by the scene/);
  await page.selectOption("#method", "stochastic");
  await page.selectOption("#options-hemicube_faces", "specular");
  assert.equal(await page.getAttribute("#options-patches", "placeholder"), "16000");
  await page.selectOption("#method", "hemilux");
  assert.equal(await page.locator("#options-patches").count(), 0);
  await page.fill("#options-gather_rays", "3");
  await page.fill("#width", "256");
  await shot("settings", { fullPage: true });
  expected = [/422.*\/v1\/jobs/];
  const [request] = await Promise.all([
    page.waitForRequest((sent) => sent.method() === "POST" && sent.url().endsWith("/v1/jobs")),
    page.getByRole("button", { name: "Start job" }).click(),
  ]);
  const { method, options } = request.postDataJSON();
  assert.deepEqual([method, options], ["hemilux", { gather_rays: 3 }]);
  await page.waitForSelector("#options-gather_rays-error:not([hidden])");
  assert.match(await text("#options-gather_rays-error"), /must be a whole number from 4 to 65536/);
  expected = [];
  await page.selectOption("#method", "auto");
  await page.locator(".more-fields summary").click();
});

test("a posted job is followed live and its picture gets better", async () => {
  await page.fill("#width", "256");
  await page.fill("#height", "256");
  await page.fill("#time_budget_s", "7");
  await page.locator(".more-fields summary").click();
  await page.fill("#snapshots", "0.5");
  await page.getByRole("button", { name: "Start job" }).click();
  await page.waitForURL(/#\/jobs\/[0-9a-f-]{36}$/);
  await state("Running");

  const shown = new Set();
  const iterations = new Set();
  const image = page.locator(".picture-image");
  const points = async () => (await page.locator(".chart-line").getAttribute("points")).split(" ").length;
  await until("three pictures and figures of three iterations while running", async () => {
    const source = await image.getAttribute("src");
    if (source) shown.add(source);
    iterations.add(await figure("iterations"));
    return shown.size >= 3 && iterations.size >= 3 && (await points()) >= 3;
  });
  assert.equal(await text(".job-title-line .pill"), "Running");
  await page.evaluate(watchLayout);
  assert.match(await figure("ratio"), /^\d+(\.\d+)?\s%$/);
  assert.match(await figure("error"), /^\d+(\.\d+)?\s%$/);
  assert.match(await text(".figure-error .figure-note"), /^\d+(\.\d+)?\s% to \d+(\.\d+)?\s%$/);
  // The list asks less often than the job's own page.
  await until("progress in the list", async () => (await page.locator(".row .bar").getAttribute("aria-valuenow")) > 0);

  await state("Done");
  assert.match(await text(".progress-text"), /time budget used up/);
  const shift = await page.evaluate(() => window.layoutShift);
  assert.ok(shift < 0.01, `the layout moved by ${shift} while figures changed`);
  const final = await until("the final picture", async () => {
    const source = await image.getAttribute("src");
    return (await text(".picture-caption")).startsWith("Final picture") && !shown.has(source) && source;
  });
  const distances = await page.evaluate(distancesToLast, [...shown, final]);
  assert.ok(distances[0] > 1.2 * distances.at(-1) && distances.at(-1) > 0, `distances to the final picture: ${distances}`);
  for (const name of ["PNG", "EXR"]) {
    const link = page.locator(".job-actions a", { hasText: name });
    assert.equal(await link.getAttribute("aria-disabled"), null);
    const [saved] = await Promise.all([page.waitForEvent("download"), link.click()]);
    assert.ok((await readFile(await saved.path())).length > 1000, `${name} is too small`);
  }
});

test("earlier snapshots can be looked at, by keyboard too", async () => {
  const slider = page.getByRole("slider", { name: "Snapshot" });
  await slider.focus();
  await page.keyboard.press("Home");
  assert.match(await text(".picture-caption"), /^Snapshot 1 of \d+ · \d+\.\d\ss/);
  await page.getByRole("button", { name: "Newest" }).click();
  assert.match(await text(".picture-caption"), /^Final picture/);
});

test("what users write is text, never markup", async () => {
  const labels = { name: HOSTILE, [HOSTILE]: HOSTILE };
  const stored = await server.upload(scene("cornell"));
  const job = await server.post({ scene: stored.id, width: 16, height: 16, max_iterations: 8, labels });
  await server.job(job.id, 20);
  await go(`#/jobs/${job.id}`);
  await until("the job", async () => (await page.locator("code[title]").first().getAttribute("title")) === job.id);
  assert.equal(await text(".job-title"), HOSTILE);
  assert.equal(await text(".job-facts .chip"), `${HOSTILE}: ${HOSTILE}`);
  await until("the row", async () => (await page.locator(".row-name", { hasText: HOSTILE }).count()) === 2);
  await page.locator(".job-facts .chip").click();
  await until("the filter by label", async () => (await page.locator(".row").count()) === 1);
  await page.locator(".chip.removable").click();
  await go("#/new");
  await until("the file's name", async () => (await text("#scene")).includes(HOSTILE));
  assert.equal(await page.locator('img[src="x"]').count(), 0);
  assert.equal(await page.evaluate(() => window.pwned), undefined);
});

test("deleting asks first", async () => {
  for (let left = 2; left > 0; left -= 1) {
    await page.locator(".row").first().click();
    await page.getByRole("button", { name: "Delete" }).click();
    await page.keyboard.press("Escape");
    await until("the dialog's end", async () => (await page.locator("dialog").count()) === 0);
    assert.equal(await page.locator(".row").count(), left);
    await page.getByRole("button", { name: "Delete" }).click();
    await page.getByRole("dialog").getByRole("button", { name: "Delete" }).click();
    await until("the row's end", async () => (await page.locator(".row").count()) === left - 1);
  }
  await until("the explanation", async () => (await page.locator(".command pre").count()) === 1);
});

test("a job can be cancelled, and what was reached stays", async () => {
  const office = await server.upload(scene("office"));
  const job = await server.post({ scene: office.id, width: 320, height: 240, time_budget_s: 120, snapshots: { every_s: 0.5 }, labels: { name: "Office, evening" } });
  await go(`#/jobs/${job.id}`);
  await page.waitForSelector(".picture-image:not([hidden])");
  const cancel = page.locator(".job-actions button", { hasText: /^Cancel/ });
  assert.equal(await cancel.isEnabled(), true);
  await cancel.click();
  await state("Cancelled");
  assert.equal(await cancel.isEnabled(), false);
  assert.equal((await server.job(job.id)).state, "cancelled");
  assert.match(await text(".progress-text"), /picture so far is kept/);
});

test("a lost connection is shown and mends itself", async () => {
  const cornell = await server.upload(scene("cornell"));
  const job = await server.post({ scene: cornell.id, width: 128, height: 128, max_iterations: 1_000_000, labels: { name: "Cornell box, long" } });
  await go(`#/jobs/${job.id}`);
  await state("Running");
  await page.waitForSelector(".log li");
  expected = [/ERR_(CONNECTION_REFUSED|INCOMPLETE_CHUNKED_ENCODING|CONNECTION_RESET|EMPTY_RESPONSE)/];
  await server.stop();
  await page.waitForSelector("#offline:not([hidden])");
  await shot("offline");
  await server.start();
  await page.waitForSelector("#offline", { state: "hidden", timeout: 20_000 });
  // The job was put back and taken up again; the stream went on where it was.
  await until("the second start", async () => (await page.locator('.log li[data-kind="running"]').count()) === 2);
  const numbers = await page.locator(".log-seq").allInnerTexts();
  assert.equal(new Set(numbers).size, numbers.length, `event numbers: ${numbers}`);
  expected = [];
  await page.locator(".job-actions button", { hasText: /^Cancel/ }).click();
  await state("Cancelled");
});

test("it looks right wide and narrow, light and dark", async () => {
  const upload = async (name) => (await server.upload(scene(name))).id;
  const [cornell, phong, corridor] = [await upload("cornell"), await upload("cornell_phong"), await upload("corridor")];
  const common = { width: 512, height: 512, snapshots: { every_s: 1 } };
  await server.post({ ...common, scene: phong, time_budget_s: 3, labels: { name: "Cornell box, glossy" } });
  const last = await server.post({ ...common, scene: corridor, width: 640, height: 360, time_budget_s: 3, labels: { name: "Corridor" } });
  await server.job(last.id, 30);
  const running = await server.post({ ...common, scene: cornell, time_budget_s: 60, target_error: 0.002, labels: { name: "Cornell box", project: "examples" } });
  await server.post({ ...common, scene: corridor, time_budget_s: 5, labels: { name: "Corridor, final" } });
  await go(`#/jobs/${running.id}`);
  const snapshots = page.locator('.log li[data-kind="snapshot"]');
  await until("some progress", async () => (await snapshots.count()) >= 3, 60_000);

  const routes = [["job", `#/jobs/${running.id}`], ["home", "#/"], ["new", "#/new"]];
  for (const [size, viewport] of [["wide", WIDE], ["narrow", NARROW]]) {
    await page.setViewportSize(viewport);
    for (const [name, route] of routes) {
      await go(route);
      if (name === "job") await page.waitForSelector(".picture-image:not([hidden])");
      if (name === "new") await page.locator(".more-fields summary").click();
      for (const colorScheme of ["light", "dark"]) {
        await page.emulateMedia({ colorScheme });
        assert.deepEqual(await page.evaluate(poorContrast), [], `contrast, ${name} ${size} ${colorScheme}`);
        await shot(`${name}-${size}-${colorScheme}`, { fullPage: size === "narrow" });
      }
      assert.deepEqual(await page.evaluate(overflowing), [], `overflow, ${name} ${size}`);
      assert.deepEqual(await page.evaluate(nameless), [], `controls without a name, ${name} ${size}`);
    }
  }
  await page.emulateMedia({ colorScheme: "light" });
  await server.cancel(running.id);
});

test("links to jobs that are not there say so", async () => {
  expected = [/404.*\/v1\/jobs\//];
  await page.setViewportSize(WIDE);
  await go("#/jobs/00000000-0000-7000-8000-000000000000");
  await until("the notice", async () => (await text(".pane")).includes("This job is not there"));
  expected = [];
});

test("a server with keys asks for one, and the page works with it", async () => {
  const closed = new Server(HEMILUX, join(scratch, "closed"));
  const key = closed.addKey("page");
  await closed.start();
  try {
    expected = [/401/];
    await page.goto(closed.url);
    const field = page.locator(".key-dialog input");
    await field.fill("hmx_wrong");
    await page.getByRole("button", { name: "Use the key" }).click();
    await until("the objection", async () => (await text("body")).includes("does not take the key"));
    assert.deepEqual(await page.evaluate(nameless), []);
    await field.fill(key);
    await page.getByRole("button", { name: "Use the key" }).click();
    await page.waitForSelector("body[data-ready]");
    // Everything that was asked with the wrong key has been answered.
    await page.waitForLoadState("networkidle");
    expected = [];

    const job = await closed.post({ scene: "cornell", width: 64, height: 48, time_budget_s: 2, snapshots: { every_s: 0.5 } });
    await go(`#/jobs/${job.id}`);
    await state("Running");
    await until("events", async () => (await page.locator(".log li").count()) >= 2);
    await state("Done");
    const width = (selector) => page.locator(selector).first().evaluate((image) => image.naturalWidth);
    await until("the picture", async () => (await width(".picture-image")) === 64);
    await until("the thumbnail", async () => (await width(".thumbnail img")) === 64);
    const [saved] = await Promise.all([page.waitForEvent("download"), page.locator(".job-actions a", { hasText: "PNG" }).click()]);
    assert.equal((await readFile(await saved.path())).subarray(1, 4).toString(), "PNG");
    // The key stays out of addresses and of what outlives the tab.
    assert.ok(!page.url().includes(key));
    assert.equal(await page.evaluate(() => Object.keys(localStorage).length + document.cookie.length), 0);
  } finally {
    await page.goto("about:blank");
    await closed.stop();
  }
});

test("the console stayed quiet and the policy was kept", () => {
  assert.deepEqual(complaints, []);
});
