// The other cells that the gateway knows: a button in the header, and the list with state and alarms that opens each.

import { request } from "./cell.js";
import { show } from "./dialogs.js";
import { h, keyed, setText } from "./dom.js";

const PERIOD = 10; // s

export class CellsView {
  constructor(cell) {
    this.cell = cell;
    this.button = h("button", { class: "small", id: "cells", hidden: true, onclick: () => this.#open() });
    this.list = h("div", { class: "list" });
    this.dialog = h("dialog", { class: "approvals", "aria-label": "Cells" }, h("form", { method: "dialog" }, h("h2", {}, "Cells"), this.list,
      h("div", { class: "end" }, h("button", { id: "close-cells" }, "Close"))));
    document.body.append(this.dialog);
    cell.addEventListener("connection", () => cell.connection === "live" && this.#read());
    setInterval(() => !this.button.hidden && this.#read(), 1000 * PERIOD);
  }

  #open() {
    show(this.dialog);
    this.#read();
  }

  async #read() {
    let cells;
    try {
      ({ cells } = await request("/api/cells"));
    } catch {
      return; // the connection says so
    }
    this.button.hidden = cells.length === 0;
    const count = cells.filter((each) => !each.is_up || each.alarms > 0).length;
    setText(this.button, count ? `Cells (${count})` : "Cells");
    this.button.title = count ? `${count} with alarms or without an answer` : "Other cells";
    keyed(this.list, cells, (each) => each.address, make, fill);
  }
}

function make({ address }) {
  const element = h("a", { class: "job-row", href: address, target: "_blank", rel: "noopener" });
  element.parts = [h("b"), h("span"), h("span", { class: "dim" })];
  element.append(...element.parts);
  return element;
}

function fill(element, { name, address, is_up, text, robots, alarms }) {
  const [title, chip, detail] = element.parts;
  setText(title, name);
  setText(chip, !is_up ? "no answer" : alarms ? `${alarms} alarm${alarms > 1 ? "s" : ""}` : "no alarms");
  chip.className = `chip ${is_up && !alarms ? "success" : "failure"}`;
  const states = Object.entries(robots).map(([state, count]) => `${count} ${state.replaceAll("_", " ")}`).join(", ");
  setText(detail, `${address}, ${is_up ? states || "no robots" : text}`);
}
