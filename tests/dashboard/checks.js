// What is looked at inside the page. These functions run in the browser.

/** Text whose contrast to what lies behind it is below WCAG AA; [] where all is well. */
export function poorContrast() {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  // The canvas reads every notation of a colour and answers in bytes.
  const rgba = (color) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = color;
    canvas.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const color = rgba(getComputedStyle(at).backgroundColor);
      if (color[3] > 0.99) return color;
    }
    return [255, 255, 255, 1];
  };
  const luminance = (color) => {
    const [r, g, b] = color.map((byte) => (byte / 255 <= 0.04045 ? byte / 255 / 12.92 : ((byte / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const found = new Set();
  for (const element of document.querySelectorAll("body *")) {
    const ownText = [...element.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim());
    const isText = element instanceof SVGTextElement;
    if (!(ownText || isText) || !element.checkVisibility({ visibilityProperty: true })) continue;
    if (element.closest(":disabled, [aria-disabled], .visually-hidden, .skip, option, script, noscript")) continue;
    const style = getComputedStyle(element);
    const [front, back] = [luminance(rgba(isText ? style.fill : style.color)), luminance(behind(element))];
    const ratio = (Math.max(front, back) + 0.05) / (Math.min(front, back) + 0.05);
    const size = Number.parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (large ? 3 : 4.5)) found.add(`${element.className.baseVal ?? element.className}: “${element.textContent.trim().slice(0, 30)}” ${ratio.toFixed(2)}`);
  }
  return [...found];
}

/** Controls without a name for screen readers. */
export function nameless() {
  const named = (element) =>
    element.textContent.trim() || element.getAttribute("aria-label") || element.title || element.labels?.length || element.querySelector("img[alt]:not([alt=''])");
  return [...document.querySelectorAll("a, button, input, select, textarea")].filter((element) => element.checkVisibility() && !named(element)).map((element) => element.outerHTML.slice(0, 120));
}

/** What sticks out of the window to the right. */
export function overflowing() {
  const root = document.scrollingElement;
  const limit = document.documentElement.clientWidth + 0.5;
  if (root.scrollWidth <= limit) return [];
  return [...document.querySelectorAll("body *")].filter((element) => element.getBoundingClientRect().right > limit).map((element) => `${element.tagName}.${element.className}`).slice(0, 5);
}

/** Root mean square difference of pictures to the last of `urls`, in bytes of sRGB. */
export async function distancesToLast(urls) {
  const read = async (url) => {
    const bitmap = await createImageBitmap(await (await fetch(url)).blob());
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, bitmap.width, bitmap.height).data;
  };
  const pictures = await Promise.all(urls.map(read));
  const last = pictures.pop();
  return pictures.map((picture) => Math.sqrt(picture.reduce((sum, byte, index) => sum + (byte - last[index]) ** 2, 0) / picture.length));
}

/** Begins to sum up how far things move by themselves, in `window.layoutShift`. */
export function watchLayout() {
  window.layoutShift = 0;
  const observer = new PerformanceObserver((list) => {
    for (const entry of list.getEntries()) if (!entry.hadRecentInput) window.layoutShift += entry.value;
  });
  observer.observe({ type: "layout-shift" });
}
