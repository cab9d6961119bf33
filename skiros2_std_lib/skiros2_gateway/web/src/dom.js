// Elements of the page, and texts for people.

// Makes an element: h("button", {class: "small", onclick: stop}, "Stop"). Children: elements, texts, null, lists of these.
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, name === "title" ? visible(value) : value);
  }
  const shown = children.flat(Infinity).filter((child) => child != null && child !== false);
  element.append(...shown.map((child) => (child instanceof Node ? child : visible(child))));
  return element;
}

// A text with control characters, direction marks and other invisible characters as codes, such as \u202e: they could
// make a text look like another one. Line breaks stay.
export const visible = (text) => String(text ?? "").replace(/[^\P{C}\n]|[\p{Zl}\p{Zp}]|(?! )\p{Zs}/gu,
  (found) => `\\u${found.codePointAt(0).toString(16).padStart(4, "0")}`);

// Changes a text only if it differs: a change costs a layout.
export function setText(element, text) {
  const shown = visible(text);
  if (element.textContent !== shown) element.textContent = shown;
}

// Keeps one element for each item of a list: `make(item)` makes it, `update(element, item)` refreshes it.
export function keyed(parent, items, key, make, update) {
  const known = (parent.known ??= new Map());
  const wanted = new Set();
  let next = parent.firstChild;
  for (const item of items) {
    const id = key(item);
    wanted.add(id);
    let element = known.get(id);
    if (!element) known.set(id, (element = make(item)));
    update(element, item);
    if (element === next) next = next.nextSibling;
    else move(parent, element, next);
  }
  for (const [id, element] of known) {
    if (!wanted.has(id)) {
      element.remove();
      known.delete(id);
    }
  }
}

// Puts an element before another one; the focus stays where it is.
function move(parent, element, next) {
  const focused = element.contains(document.activeElement) ? /** @type {HTMLElement} */ (document.activeElement) : null;
  parent.insertBefore(element, next);
  if (focused !== document.activeElement) focused?.focus({ preventScroll: true });
}

// A duration (s): "0.42 s", "12.3 s", "3:05", "1:02:03".
export function duration(seconds) {
  if (!(seconds >= 0)) return "";
  if (seconds < 10) return `${seconds.toFixed(2)} s`;
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  const whole = Math.floor(seconds);
  const parts = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  if (!parts[0]) parts.shift();
  return parts.map((part, index) => (index ? String(part).padStart(2, "0") : part)).join(":");
}

// The first line of a text that may have more.
export const firstLine = (text) => text.split("\n", 1)[0];

// A time of day (s since the epoch).
export const clock = (time) => new Date(time * 1000).toLocaleTimeString([], { hour12: false });

// A time (s since the epoch): of this day without the date.
export function moment(time, now) {
  const day = (each) => new Date(each * 1000).toLocaleDateString([], { month: "short", day: "numeric" });
  return day(time) === day(now) ? clock(time) : `${day(time)}, ${clock(time)}`;
}

// The name without prefix of a class, an id, or a label that is such a name.
export const localName = (name) => name.replace(/^[\w.-]*:(?=\S+$)/, "");

export function number(value) {
  if (typeof value !== "number") return String(value);
  return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(5)));
}

// Shows a message for some seconds.
export function notice(text, role = "failure") {
  const element = h("div", { class: `notice ${role}` }, text);
  document.getElementById("notices").append(element);
  setTimeout(() => element.remove(), role === "failure" ? 12000 : 4000);
}
