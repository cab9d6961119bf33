// Dialogs. While one is open the rest of the page is inert, except the button Stop: a modal dialog of the browser would
// keep that out of reach, too. Esc closes the topmost one, and the focus returns to where it was.

import { h } from "./dom.js";

const openDialogs = () => /** @type {HTMLDialogElement[]} */ ([...document.querySelectorAll("dialog[open]")]);

function update() {
  const dialogs = openDialogs();
  dialogs.forEach((dialog, i) => (dialog.inert = i < dialogs.length - 1));
  for (const each of document.querySelectorAll("main, body > nav, #header > :not(#stop-all)"))
    /** @type {HTMLElement} */ (each).inert = dialogs.length > 0;
}

document.addEventListener("keydown", (event) => {
  const top = openDialogs().at(-1);
  if (event.key !== "Escape" || !top || top.matches(":modal")) return;
  event.preventDefault();
  top.close();
});

export function show(dialog) {
  if (dialog.open) return;
  const before = /** @type {HTMLElement} */ (document.activeElement);
  dialog.addEventListener("close", () => {
    update();
    before?.focus();
  }, { once: true });
  dialog.show();
  update();
}

// Makes and shows a dialog that is removed when it is closed.
export function openDialog(name, label, ...content) {
  const element = h("dialog", { class: `approvals ${name}`, "aria-label": label }, h("form", { method: "dialog" }, ...content,
    h("div", { class: "end" }, h("button", { id: `close-${name}` }, "Close"))));
  element.addEventListener("close", () => element.remove());
  /** @type {HTMLDialogElement} */ (document.querySelector(`dialog.${name}`))?.close();
  document.body.append(element);
  show(element);
  return element;
}
