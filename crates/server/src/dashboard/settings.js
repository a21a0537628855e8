// The settings of a method as fields of a form, made from what the server lists.

import { h } from "./dom.js";
import { field, number } from "./field.js";

/** A control for one setting; left as it is, the setting has its default. */
function controlOf(setting) {
  const choice = (words) => h("select", {}, h("option", { value: "" }, `default (${setting.default})`), words.map((word) => h("option", { value: word }, word)));
  if (setting.values === "switch") return choice(["true", "false"]);
  if (setting.values === "words") return choice(setting.words);
  const step = setting.values === "whole" ? setting.step : "any";
  return number("", { min: setting.low, max: setting.high, step, placeholder: setting.default });
}

/** A control's value with the type that the setting has. */
function typed(setting, text) {
  if (setting.values === "switch") return text === "true";
  return setting.values === "words" ? text : Number(text);
}

export class MethodSettings {
  /** `onInput()` hears of every change. */
  constructor(onInput) {
    this.onInput = onInput;
    this.shown = [];
    this.root = h("div", { class: "field-grid", "aria-live": "polite" });
  }

  /** Shows the settings of a method. */
  show(method, listed) {
    this.shown = listed.filter((setting) => setting.method === method).map((setting) => {
      const made = field(`options-${setting.name}`, setting.name, controlOf(setting), { hint: setting.meaning, unit: setting.unit });
      made.control.addEventListener("input", this.onInput);
      return { setting, ...made };
    });
    const none = h("p", { class: "hint" }, `${method} picks a method by the scene; choose one to set it up.`);
    this.root.replaceChildren(...(this.shown.length ? this.shown.map(({ root }) => root) : [none]));
  }

  /** Name and value of what was set; `wrong(name, message)` hears of what can't be read. */
  read(wrong) {
    const options = {};
    for (const { setting, control } of this.shown) {
      if (control.validity.badInput) wrong(`options.${setting.name}`, "must be a number");
      else if (control.value !== "") options[setting.name] = typed(setting, control.value);
    }
    return options;
  }

  /** The field of a path into the request. */
  find(path) {
    return this.shown.find(({ setting }) => path === `options.${setting.name}`);
  }
}
