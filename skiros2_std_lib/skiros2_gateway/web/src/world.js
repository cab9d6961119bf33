// The world model as a tree of what contains or has what, with the properties of the selected element.

import { showFacts } from "./details.js";
import { clock, h, keyed, localName, number, setText } from "./dom.js";

const PARTS = new Set(["skiros:contain", "skiros:hasA"]);
const ROOT = "skiros:Scene-0";

// The selected element, shared by the tree and the 3D view, and the selected robot: that of the element, by the name of
// its manager; "" for all. Dispatches `change`.
export class Selection extends EventTarget {
  id = null;
  robot = "";

  constructor(cell) {
    super();
    this.cell = cell;
  }

  select(id) {
    this.id = id;
    this.robot = robotOfElement(id, this.cell.document.elements) || this.robot;
    this.dispatchEvent(new Event("change"));
  }

  selectRobot(name) {
    const { elements } = this.cell.document;
    this.robot = name;
    this.id = Object.keys(elements).find((id) => name && managerOf(elements[id]) === name) ?? this.id;
    this.dispatchEvent(new Event("change"));
  }
}

const managerOf = (element) => element?.properties["skiros:SkillMgr"]?.map((name) => `/${String(name).replace(/^\/+/, "")}`)[0] ?? "";

// The robot that has an element as a part of its parts, or is it.
function robotOfElement(id, elements) {
  const seen = new Set();
  while (id && elements[id] && !seen.has(id)) {
    if (managerOf(elements[id])) return managerOf(elements[id]);
    seen.add(id);
    id = Object.keys(elements).find((other) => elements[other].relations.some(([type, part]) => type === "skiros:hasA" && part === id));
  }
  return "";
}

export class WorldView {
  tables = ["elements"];
  #collapsed = new Set();

  constructor(panel, cell, run, selection) {
    this.cell = cell;
    this.run = run;
    this.selection = selection;
    this.filter = h("input", { type: "search", placeholder: "Find an element", "aria-label": "Find an element", oninput: () => this.render() });
    this.count = h("span", { class: "dim grow" });
    this.list = h("div", { class: "world", role: "tree" });
    this.title = h("h2");
    this.facts = h("dl", { class: "facts" });
    this.relations = h("div", { class: "relations" });
    this.details = h("aside", { class: "details", hidden: true },
      h("header", {}, this.title, h("button", { class: "small", "aria-label": "Close", onclick: () => selection.select(null) }, "✕")),
      this.facts, this.relations);
    panel.append(h("div", { class: "tools" }, this.filter, this.count), this.list, this.details);
  }

  render() {
    const { elements } = this.run.shownScene;
    const rows = this.filter.value ? this.#found(elements) : this.#flatten(elements);
    const { sceneTime } = this.run;
    setText(this.count, `${rows.length} elements${sceneTime === null ? "" : ` at ${clock(sceneTime)}`}`);
    keyed(this.list, rows, (row) => row.key, (row) => this.#make(row), (item, row) => {
      item.style.setProperty("--depth", row.depth);
      item.classList.toggle("selected", row.id === this.selection.id);
      setText(item.children[0], row.isParent ? (this.#collapsed.has(row.id) ? "▸" : "▾") : "");
      setText(item.children[1], localName(elements[row.id].label || row.id));
      setText(item.children[2], localName(elements[row.id].type));
    });
    this.#showDetails(elements[this.selection.id]);
  }

  #make(row) {
    const toggle = (event) => {
      event.stopPropagation();
      if (!this.#collapsed.delete(row.id)) this.#collapsed.add(row.id);
      this.render();
    };
    return h("div", { class: "row", role: "treeitem", tabindex: 0, onclick: () => this.selection.select(row.id),
      onkeydown: (event) => event.key === "Enter" && this.selection.select(row.id) },
    h("span", { class: "twist", onclick: toggle }), h("span", { class: "name" }), h("span", { class: "type" }));
  }

  #flatten(elements) {
    const rows = [];
    const seen = new Set();
    const visit = (id, depth) => {
      if (seen.has(id) || !elements[id]) return;
      seen.add(id);
      const parts = elements[id].relations.filter(([type]) => PARTS.has(type)).map(([, part]) => part);
      rows.push({ id, key: id, depth, isParent: parts.length > 0 });
      if (!this.#collapsed.has(id)) for (const part of parts) visit(part, depth + 1);
    };
    visit(ROOT, 0);
    return rows;
  }

  #found(elements) {
    const text = this.filter.value.trim().toLowerCase();
    return Object.values(elements)
      .filter((element) => `${element.label} ${element.id} ${element.type}`.toLowerCase().includes(text))
      .slice(0, 500)
      .map(({ id }) => ({ id, key: id, depth: 0, isParent: false }));
  }

  #showDetails(element) {
    this.details.hidden = !element;
    if (!element) return;
    setText(this.title, localName(element.label || element.id));
    const known = Object.entries(element.properties).filter(([, values]) => values.length);
    const facts = known.map(([key, values]) => [localName(key), values.map(number).join(", ")]);
    showFacts(this.facts, [["Id", element.id], ["Type", element.type], ...facts.sort(([a], [b]) => a.localeCompare(b))]);
    const related = element.relations.filter(([type]) => type !== "skiros:hasSkill");
    keyed(this.relations, related, (each) => each.join(" "), ([type, id]) =>
      h("button", { class: "link", onclick: () => this.selection.select(id) }, `${localName(type)} `, h("b")),
    (item, [, id]) => setText(item.lastChild, this.cell.label(id)));
  }
}
