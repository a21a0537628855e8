// The form for a new job. The server judges what was filled in; its answer names the fields, and
// the page shows each message where it belongs.

import * as api from "./api.js";
import { announce, copyButton, h, icon, setAttribute, setText, setVariable } from "./dom.js";
import { field, number } from "./field.js";
import { bytes, count, shortHash } from "./format.js";
import { MethodSettings } from "./settings.js";

const MAX_LABEL_CHARS = 64;

/** Makes repeating a request safe; `randomUUID` is missing on pages without TLS. */
function newKey() {
  const random = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(random, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** Lines of a name, the separator and a value, as an object. */
function readLines(text, separator, read) {
  const found = {};
  for (const line of text.split("\n").map((part) => part.trim()).filter(Boolean)) {
    const at = line.indexOf(separator);
    if (at < 1) throw new Error(`write one name${separator}value a line, not “${line}”`);
    found[line.slice(0, at).trim()] = read(line.slice(at + 1).trim());
  }
  return found;
}

/** Skies to choose from: value and name. */
const SKIES = [["", "As the scene needs"], ["none", "None"], ["studio", "Studio"], ["white", "White all around"]];

/** Backgrounds to choose from: value and name. */
const BACKGROUNDS = [["", "The sky"], ["transparent", "Transparent"], ["white", "White"], ["black", "Black"]];
/** Radiances of the colours among them. */
const COLOURS = { white: [1, 1, 1], black: [0, 0, 0] };

export class JobForm {
  /** `nameOfScene(id)` may know what a scene was used for; `onAccepted(job)` hears of the job. */
  constructor(nameOfScene, onAccepted) {
    this.nameOfScene = nameOfScene;
    this.onAccepted = onAccepted;
    this.key = newKey();
    this.scenes = [];
    this.environments = [];
    this.build();
    this.load();
  }

  build() {
    const scene = h("select", { on: { change: () => this.chose() } });
    const camera = h("select", {}, h("option", { value: "" }, "The scene's first"));
    const variant = h("select", {}, h("option", { value: "" }, "As the file shows it"));
    const part = h("select", {}, h("option", { value: "" }, "The file's default"));
    const animation = h("select", { on: { change: () => this.choseAnimation() } }, h("option", { value: "" }, "None: at rest"));
    const sky = h("select", {}, SKIES.map(([value, name]) => h("option", { value }, name)));
    const background = h("select", {}, BACKGROUNDS.map(([value, name]) => h("option", { value }, name)));
    const units = h("select", {}, [["", "Photometric (cd/m²)"], ["radiometric", "Radiometric (W/(m² sr))"]].map(([value, name]) => h("option", { value }, name)));
    const method = h("select", {}, h("option", { value: "auto" }, "auto"));
    this.fields = {
      scene: field("scene", "Stored or built-in scene", scene),
      camera: field("camera", "Camera", camera),
      variant: field("variant", "Materials", variant, { hint: "Of the sets that the scene offers." }),
      gltf_scene: field("gltf_scene", "Scene in the file", part),
      animation: field("animation", "Animation", animation),
      time: field("time", "Moment of it", number(0, { min: 0 }), { unit: "s" }),
      environment: field("environment", "Sky", sky, { hint: "By default none where the scene has lights, else the studio. A map (.exr, .hdr) is uploaded as a scene is." }),
      background: field("background", "Background", background, { hint: "What the camera sees beside the surfaces; light stays as it is." }),
      units: field("units", "Units of the EXR", units, { hint: "Written into its header; nothing is converted." }),
      name: field("name", "Name", h("input", { type: "text", maxlength: MAX_LABEL_CHARS, autocomplete: "off" }), { hint: "Shown in the list; kept as the label “name”." }),
      width: field("width", "Width", number(512, { min: 1, step: 1 }), { unit: "px" }),
      height: field("height", "Height", number(512, { min: 1, step: 1 }), { unit: "px" }),
      time_budget_s: field("time_budget_s", "Time", number(20, { min: 0 }), { unit: "s" }),
      target_error: field("target_error", "Estimated error", number("", { min: 0, max: 100, placeholder: "none" }), { unit: "%" }),
      max_iterations: field("max_iterations", "Iterations", number("", { min: 1, step: 1, placeholder: "none" })),
      method: field("method", "Method", method, { hint: "auto looks at the scene and says in the plan why it chose." }),
      snapshots: field("snapshots", "Snapshot every", number(1, { min: 0.1, placeholder: "none" }), { unit: "s", hint: "Empty: the final picture only." }),
      seed: field("seed", "Seed", number(0, { min: 0, step: 1 })),
      priority: field("priority", "Priority", number(0, { min: -100, max: 100, step: 1 }), { hint: "Higher starts first." }),
      labels: field("labels", "Labels", h("textarea", { rows: 3, spellcheck: "false", placeholder: "project:atrium" }), { hint: "One key:value a line." }),
    };
    const { fields } = this;
    // Another request needs another key.
    const changed = () => { this.key = newKey(); };
    for (const { control } of Object.values(fields)) control.addEventListener("input", changed);
    this.settings = new MethodSettings(changed);
    method.addEventListener("change", () => this.showSettings());
    this.files = h("input", { type: "file", id: "files", class: "visually-hidden", multiple: true, accept: ".glb,.gltf,.zip,.bin,.exr,.hdr,.png,.jpg,.jpeg,.webp,.ktx2,model/gltf-binary,model/gltf+json", on: { change: () => this.take([...this.files.files]) } });
    this.dropText = h("span", {}, h("strong", {}, "Upload a scene"), " or drop it here");
    this.dropHint = h("span", { class: "hint" }, ".glb, .zip, or a .gltf together with its files");
    this.drop = h("label", { class: "drop", for: "files" }, icon("upload"), this.dropText, this.dropHint, h("span", { class: "bar", "aria-hidden": "true" }, h("span", { class: "bar-fill" })));
    for (const event of ["dragenter", "dragover"]) this.drop.addEventListener(event, (e) => this.dragged(e, true));
    this.drop.addEventListener("dragleave", (e) => this.dragged(e, false));
    this.drop.addEventListener("drop", (e) => {
      this.dragged(e, false);
      this.take([...e.dataTransfer.files]);
    });
    this.sceneFacts = h("div", { class: "scene-facts", "aria-live": "polite" });
    this.summary = h("div", { class: "notice bad", role: "alert", tabindex: "-1", hidden: true });
    this.submit = h("button", { type: "submit", class: "button primary" }, "Start job");
    this.more = h("details", { class: "more-fields" }, h("summary", {}, "More settings"),
      h("div", { class: "field-grid" }, fields.method.root, fields.snapshots.root, fields.camera.root, fields.variant.root, fields.gltf_scene.root, fields.animation.root, fields.time.root, fields.environment.root, fields.background.root, fields.units.root, fields.seed.root, fields.priority.root, fields.labels.root),
      h("fieldset", {}, h("legend", {}, "Settings of the method"), this.settings.root));
    const group = (title, ...rows) => h("fieldset", {}, h("legend", {}, title), rows);
    this.heading = h("h2", { tabindex: "-1" }, "New job");
    this.form = h("form", { novalidate: true, on: { submit: (event) => this.send(event) } },
      this.summary,
      group("Scene", h("div", { class: "field-grid two" }, h("div", {}, this.files, this.drop), h("div", {}, fields.scene.root, this.sceneFacts))),
      group("Picture", h("div", { class: "field-grid" }, fields.width.root, fields.height.root, fields.name.root)),
      group("Stop at whichever comes first", h("div", { class: "field-grid" }, fields.time_budget_s.root, fields.target_error.root, fields.max_iterations.root)),
      this.more,
      h("div", { class: "actions" }, this.submit, copyButton("Copy as curl", () => this.curl())));
    this.root = h("div", { class: "new-job card" }, this.heading, this.form);
  }

  focus() {
    this.heading.focus({ preventScroll: true });
  }

  close() {
    this.closed = true;
  }

  async load() {
    try {
      const [about, scenes, environments] = await Promise.all([api.about(), api.scenes(), api.environments()]);
      if (this.closed) return;
      this.about = about;
      this.scenes = scenes;
      this.environments = environments;
      const { width, height, time_budget_s: time, method } = this.fields;
      for (const { control } of [width, height]) setAttribute(control, "max", about.max_side);
      setAttribute(time.control, "max", about.max_seconds);
      method.control.replaceChildren(...about.methods.map((name) => h("option", { value: name }, name)));
      this.showSettings();
      setText(this.dropHint, `.glb, .zip, or a .gltf together with its files; at most ${about.max_upload_mb} MiB`);
      this.listScenes();
      this.listSkies();
    } catch (problem) {
      if (!this.closed) this.fail(problem.message);
    }
  }

  showSettings() {
    this.settings.show(this.fields.method.control.value, this.about?.settings ?? []);
  }

  listScenes(chosen) {
    const stored = this.scenes.map((scene) => {
      const name = scene.name ?? this.nameOfScene(scene.id) ?? `Scene ${shortHash(scene.id)}`;
      return h("option", { value: scene.id }, `${name} (${count(scene.triangles)} triangles)`);
    });
    const builtin = (this.about?.builtin_scenes ?? []).map((name) => h("option", { value: name }, name));
    const groups = [];
    if (stored.length) groups.push(h("optgroup", { label: "Stored" }, stored));
    if (builtin.length) groups.push(h("optgroup", { label: "Built in" }, builtin));
    const { control } = this.fields.scene;
    control.replaceChildren(...(groups.length ? groups : [h("option", { value: "" }, "None yet: upload one")]));
    if (chosen) control.value = chosen;
    this.chose();
  }

  /** Lists the skies, stored maps among them; a map's value is its id. */
  listSkies(chosen) {
    const { control } = this.fields.environment;
    const before = chosen ?? control.value;
    const words = SKIES.map(([value, name]) => h("option", { value }, name));
    const maps = this.environments.map(({ id, name, width, height }) =>
      h("option", { value: id }, `${name ?? `Map ${shortHash(id)}`} (${width} × ${height})`));
    control.replaceChildren(...words, ...(maps.length ? [h("optgroup", { label: "Stored maps" }, maps)] : []));
    control.value = before;
  }

  /** Shows what is known of the chosen scene. */
  chose() {
    const id = this.fields.scene.control.value;
    const scene = this.scenes.find((known) => known.id === id);
    const cameras = (scene?.cameras ?? []).map(({ index, name }) => h("option", { value: index }, name));
    this.fields.camera.control.replaceChildren(h("option", { value: "" }, "The scene's first"), ...cameras);
    const variants = (scene?.variants ?? []).map((name) => h("option", { value: name }, name));
    this.fields.variant.control.replaceChildren(h("option", { value: "" }, "As the file shows it"), ...variants);
    this.fields.variant.root.hidden = variants.length === 0;
    const option = ({ index, name }) => h("option", { value: index }, name ?? `Number ${index}`);
    const parts = scene?.gltf_scenes ?? [];
    this.fields.gltf_scene.control.replaceChildren(h("option", { value: "" }, "The file's default"), ...parts.map(option));
    this.fields.gltf_scene.root.hidden = parts.length < 2;
    const animations = scene?.animations ?? [];
    this.fields.animation.control.replaceChildren(h("option", { value: "" }, "None: at rest"), ...animations.map(option));
    this.fields.animation.root.hidden = animations.length === 0;
    this.choseAnimation();
    if (!scene) {
      this.sceneFacts.replaceChildren();
      return;
    }
    const facts = [
      bytes(scene.size), `${count(scene.triangles)} triangles`, `${count(scene.lights)} of them light sources`,
      `${count(scene.cameras.length)} ${scene.cameras.length === 1 ? "camera" : "cameras"}`,
    ];
    const warnings = scene.warnings.map(({ at, what }) => h("li", {}, h("code", {}, at), " ", what));
    this.sceneFacts.replaceChildren(
      h("p", { class: "hint" }, facts.join(" · ")),
      h("button", { type: "button", class: "button small quiet", title: "Jobs that use it keep it", on: { click: () => this.letGo(scene) } }, "Remove this scene"),
      ...(warnings.length ? [h("details", { class: "hint" }, h("summary", {}, `${warnings.length} things are approximated or ignored`), h("ul", { class: "warnings" }, warnings))] : []));
  }

  /** Asks for a moment where something moves. */
  choseAnimation() {
    this.fields.time.root.hidden = this.fields.animation.control.value === "";
  }

  /** Takes the scene off the list; on the server it stays for the jobs that use it. */
  async letGo(scene) {
    try {
      await api.removeScene(scene.id);
      if (this.closed) return;
      this.scenes = this.scenes.filter((known) => known.id !== scene.id);
      this.listScenes();
      announce("The scene is removed");
    } catch (problem) {
      this.mark("scene", problem.message);
    }
  }

  dragged(event, over) {
    event.preventDefault();
    setAttribute(this.drop, "data-over", over);
  }

  async take(files) {
    if (files.length === 0) return;
    this.clearErrors();
    const sky = files.length === 1 && api.isSky(files[0]);
    const main = sky ? files[0] : api.mainFile(files);
    if (!main) {
      this.mark("scene", "choose a .glb or .zip file, a .gltf file with what it refers to, or a sky as .exr or .hdr");
      return;
    }
    const limit = (this.about?.max_upload_mb ?? Infinity) * 2 ** 20;
    if (files.reduce((sum, file) => sum + file.size, 0) > limit) {
      this.mark("scene", `uploads may have at most ${this.about.max_upload_mb} MiB`);
      return;
    }
    setAttribute(this.drop, "data-busy", true);
    this.files.disabled = true;
    this.submit.disabled = true;
    this.dropText.replaceChildren("Uploading ", h("strong", {}, main.name));
    try {
      const heard = (share) => setVariable(this.drop, "--share", share);
      if (sky) {
        await this.takeSky(main, heard);
        return;
      }
      const scene = await api.uploadScene(files, heard);
      if (this.closed) return;
      this.scenes = [scene, ...this.scenes.filter((known) => known.id !== scene.id)];
      this.listScenes(scene.id);
      this.key = newKey();
      const { control } = this.fields.name;
      if (!control.value) control.value = main.name.replace(/\.(glb|gltf|zip)$/i, "").slice(0, MAX_LABEL_CHARS);
      this.dropText.replaceChildren(h("strong", {}, main.name), " is stored");
      announce("The scene is stored");
    } catch (problem) {
      this.dropText.replaceChildren(h("strong", {}, "Upload a scene"), " or drop it here");
      this.mark(sky ? "environment" : "scene", problem.message);
    } finally {
      setAttribute(this.drop, "data-busy", null);
      this.files.disabled = false;
      // The same file may be chosen again, mended.
      this.files.value = "";
      this.submit.disabled = false;
    }
  }

  /** Stores a map of a sky and chooses it. */
  async takeSky(file, heard) {
    const map = await api.uploadEnvironment(file, heard);
    if (this.closed) return;
    this.environments = [map, ...this.environments.filter((known) => known.id !== map.id)];
    this.listSkies(map.id);
    this.key = newKey();
    this.more.open = true;
    this.dropText.replaceChildren(h("strong", {}, file.name), " is stored and chosen as the sky");
    announce("The sky is stored");
  }

  /** The job as filled in; marks what cannot be read and answers null. */
  read() {
    const { fields } = this;
    let readable = true;
    const wrong = (name, message) => {
      this.mark(name, message);
      readable = false;
    };
    const numeric = (name) => {
      const { control } = fields[name];
      if (control.validity.badInput) wrong(name, "must be a number");
      return control.value === "" ? null : Number(control.value);
    };
    const required = (name) => {
      const value = numeric(name);
      if (value === null && !fields[name].control.validity.badInput) wrong(name, "required");
      return value;
    };
    const lines = (name, separator, read) => {
      try {
        return readLines(fields[name].control.value, separator, read);
      } catch (error) {
        wrong(name, error.message);
        return {};
      }
    };
    const job = {
      scene: fields.scene.control.value,
      method: fields.method.control.value,
      width: required("width"),
      height: required("height"),
      labels: lines("labels", ":", String),
      options: this.settings.read(wrong),
    };
    if (!job.scene) wrong("scene", "upload a scene, or choose a stored one");
    const camera = fields.camera.control.value;
    if (camera !== "") job.camera = Number(camera);
    const variant = fields.variant.control.value;
    if (variant !== "") job.variant = variant;
    const part = fields.gltf_scene.control.value;
    if (part !== "") job.gltf_scene = Number(part);
    const animation = fields.animation.control.value;
    if (animation !== "") {
      job.animation = Number(animation);
      const time = numeric("time");
      if (time !== null) job.time = time;
    }
    const sky = fields.environment.control.value;
    const isStored = this.environments.some(({ id }) => id === sky);
    if (sky !== "") job.environment = { sky: isStored ? { environment: sky } : sky === "white" ? [1, 1, 1] : sky };
    const background = fields.background.control.value;
    if (background !== "") job.background = COLOURS[background] ?? background;
    const units = fields.units.control.value;
    if (units !== "") job.units = units;
    for (const name of ["time_budget_s", "max_iterations", "seed", "priority"]) {
      const value = numeric(name);
      if (value !== null) job[name] = value;
    }
    const target = numeric("target_error");
    if (target !== null) {
      // The server speaks of shares of 1; the form of per cent.
      if (target > 0 && target < 100) job.target_error = target / 100;
      else wrong("target_error", "must be above 0 % and below 100 %");
    }
    const every = numeric("snapshots");
    if (every !== null) job.snapshots = { every_s: every };
    const name = fields.name.control.value.trim();
    if (name) job.labels.name = name;
    return readable ? job : null;
  }

  curl() {
    this.clearErrors();
    const job = this.read();
    return job ? api.curlFor(job) : "";
  }

  async send(event) {
    event.preventDefault();
    this.clearErrors();
    const job = this.read();
    if (!job) {
      this.fail("Some fields need another look.");
      return;
    }
    this.submit.disabled = true;
    setText(this.submit, "Sending…");
    try {
      this.onAccepted(await api.createJob(job, this.key));
    } catch (problem) {
      const homeless = (problem.errors ?? []).filter(({ field: path, detail }) => !this.mark(this.fieldOf(path), detail));
      const shown = (problem.errors?.length ?? 0) > homeless.length;
      this.fail(shown ? "Some fields need another look." : problem.message, shown ? homeless : []);
    } finally {
      this.submit.disabled = false;
      setText(this.submit, "Start job");
    }
  }

  /** The form's field for a path into the request. */
  fieldOf(path) {
    if (path === "labels.name") return "name";
    return this.settings.find(path) ? path : path.split(/[.[]/)[0];
  }

  /** Shows an error at its field; false where the form has none. */
  mark(name, message) {
    const found = this.fields[name] ?? this.settings.find(name);
    if (!found) return false;
    setText(found.error, message);
    found.error.hidden = false;
    setAttribute(found.control, "aria-invalid", "true");
    if (this.more.contains(found.root)) this.more.open = true;
    return true;
  }

  clearErrors() {
    this.summary.hidden = true;
    for (const { control, error } of [...Object.values(this.fields), ...this.settings.shown]) {
      error.hidden = true;
      setAttribute(control, "aria-invalid", null);
    }
  }

  fail(message, homeless = []) {
    this.summary.replaceChildren(h("p", {}, message), ...homeless.map(({ field: path, detail }) => h("p", {}, h("code", {}, path), " ", detail)));
    this.summary.hidden = false;
    const first = this.form.querySelector("[aria-invalid]");
    (first ?? this.summary).focus();
  }
}
