// The API key, where the server asks for one: kept for this tab only, sent with every request.

import { h } from "./dom.js";

const NAME = "hemilux-key";

export const key = () => sessionStorage.getItem(NAME) ?? "";

/** Headers that carry the key, where there is one. */
export const headers = () => (key() ? { authorization: `Bearer ${key()}` } : {});

/** Asks for a key; `onKey` hears when there is a new one. */
export function askForKey(onKey) {
  if (document.querySelector(".key-dialog")) return;
  const field = h("input", { type: "password", name: "key", autocomplete: "off", spellcheck: "false", required: true, "aria-label": "API key", placeholder: "hmx_…" });
  const hint = key() ? "The server does not take the key that this page has." : "This server asks for an API key; its operator makes them with “hemilux keys add”.";
  const form = h("form", { method: "dialog" },
    h("h2", { id: "key-title" }, "API key"),
    h("p", {}, hint),
    h("p", {}, field),
    h("p", { class: "hint" }, "Kept in this tab until it is closed."),
    h("div", { class: "actions" },
      h("button", { type: "button", class: "button", on: { click: () => dialog.close() } }, "Not now"),
      h("button", { type: "submit", class: "button primary" }, "Use the key")));
  const dialog = h("dialog", { class: "dialog key-dialog", "aria-labelledby": "key-title" }, form);
  form.addEventListener("submit", () => {
    sessionStorage.setItem(NAME, field.value.trim());
    onKey();
  });
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  field.focus();
}

/** Addresses of pictures, as they were fetched with the key: the newest few. */
const fetched = new Map();
const MAX_FETCHED = 64;

/**
 * An address that an image element can load: elements send no headers, so with a key the file is
 * fetched first. Throws where it cannot be had.
 */
export async function loadable(url) {
  if (!key()) return url;
  if (fetched.has(url)) return fetched.get(url);
  const response = await fetch(url, { headers: headers() });
  if (!response.ok) throw new Error(`The server answered ${response.status}.`);
  const local = URL.createObjectURL(await response.blob());
  fetched.set(url, local);
  if (fetched.size > MAX_FETCHED) {
    const [oldest, gone] = fetched.entries().next().value;
    fetched.delete(oldest);
    URL.revokeObjectURL(gone);
  }
  return local;
}

/** Links to files of the API carry no key either: fetches what such a link leads to. */
export async function followLink(event) {
  const link = event.target.closest?.("a[href]");
  const path = link?.getAttribute("href") ?? "";
  if (!key() || event.defaultPrevented || !(path.startsWith("/v1/") || path === "/metrics")) return;
  event.preventDefault();
  try {
    const local = await loadable(path);
    const saved = h("a", { href: local, download: link.getAttribute("download") ?? path.split("/").at(-1) });
    saved.click();
  } catch {
    // Gone with its job, or the connection is; the page says so by itself.
  }
}
