// Labelled fields of a form, with their hints and errors.

import { h, setAttribute } from "./dom.js";

/** A labelled control with a place for its hint and its error. */
export function field(name, title, control, { hint, unit } = {}) {
  const error = h("p", { class: "field-error", id: `${name}-error`, hidden: true });
  const help = hint ? h("p", { class: "hint", id: `${name}-hint` }, hint) : null;
  control.id = name;
  setAttribute(control, "aria-describedby", [hint && `${name}-hint`, `${name}-error`].filter(Boolean).join(" "));
  const root = h("div", { class: "field", "data-field": name },
    h("label", { for: name }, title),
    unit ? h("div", { class: "with-unit" }, control, h("span", { class: "unit", "aria-hidden": "true" }, unit)) : control,
    help, error);
  return { root, control, error };
}

/** A control for a number. */
export const number = (value, attributes = {}) =>
  h("input", { type: "number", inputmode: "decimal", step: "any", value, autocomplete: "off", ...attributes });
