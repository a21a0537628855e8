// Building elements. Text always becomes a text node, so nothing that a user wrote can turn into
// markup.

function append(node, children) {
  for (const child of children.flat(Infinity)) {
    if (child !== null && child !== undefined && child !== false) node.append(child);
  }
  return node;
}

function setAttributes(node, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "on") {
      for (const [event, handler] of Object.entries(value)) node.addEventListener(event, handler);
    } else {
      setAttribute(node, name, value);
    }
  }
  return node;
}

/** An HTML element; `attributes.on` holds its listeners. */
export function h(tag, attributes = {}, ...children) {
  return append(setAttributes(document.createElement(tag), attributes), children);
}

/** An SVG element. */
export function svg(tag, attributes = {}, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  return append(setAttributes(node, attributes), children);
}

/** Sets an attribute where it differs; true is the empty one, false, null and undefined none. */
export function setAttribute(node, name, value) {
  if (value === false || value === null || value === undefined) {
    if (node.hasAttribute(name)) node.removeAttribute(name);
    return;
  }
  const text = value === true ? "" : String(value);
  if (node.getAttribute(name) !== text) node.setAttribute(name, text);
}

/** Sets the text where it differs, so that a selection survives a refresh without news. */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** A CSS custom property, through the object model, which the page's policy allows. */
export function setVariable(node, name, value) {
  node.style.setProperty(name, value);
}

/** Says something to screen readers. */
export function announce(text) {
  document.getElementById("announcer").textContent = text;
}

/** A button that copies what `text()` gives, if that is anything. */
export function copyButton(label, text) {
  const button = h("button", { type: "button", class: "button small quiet" }, label);
  let timer = 0;
  button.addEventListener("click", async () => {
    const copied = text();
    let said = copied ? "Copied" : "Nothing to copy yet";
    try {
      if (copied) await navigator.clipboard.writeText(copied);
    } catch {
      // Pages from other machines without TLS have no clipboard.
      said = "Select and copy by hand";
    }
    setText(button, said);
    announce(said);
    clearTimeout(timer);
    timer = setTimeout(() => setText(button, label), 1600);
  });
  return button;
}

const ICONS = {
  plus: "M8 3v10M3 8h10",
  back: "M9.5 3.5 5 8l4.5 4.5",
  download: "M8 2.5v7.5M4.8 7 8 10.2 11.2 7M3 13.5h10",
  stop: "M4.5 4.5h7v7h-7z",
  trash: "M3 4.5h10M6.5 4.5v-2h3v2M4.5 4.5l.6 9h5.8l.6-9M6.8 7v4M9.2 7v4",
  upload: "M8 10.5V3M4.8 6 8 2.8 11.2 6M3 13.5h10",
  close: "m4 4 8 8M12 4l-8 8",
  open: "M6.5 3.5h-3v9h9v-3M9 3h4v4M13 3 7.5 8.5",
};

/** A drawn sign of 16 by 16 pixels; the text beside it says what it means. */
export function icon(name) {
  return svg("svg", { class: "icon", viewBox: "0 0 16 16", "aria-hidden": "true" }, svg("path", { d: ICONS[name] }));
}
