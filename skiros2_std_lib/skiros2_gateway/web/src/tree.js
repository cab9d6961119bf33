// The tree of a run. Only the rows in sight exist as elements, so that thousands of nodes cost what a screen costs.

import { duration, h, localName, setText } from "./dom.js";

const RUNNING = 3;
const MARGIN = 6; // rows above and below the visible part
const MANY = 300; // nodes; larger trees are shown with idle and ended parts collapsed
const COMPOUND_LIMIT = 1; // depth that is expanded in large trees even if nothing runs there

export class TreeView {
  tables = ["runs", "trees"];
  #collapsed = new Map(); // by node id: chosen by hand
  #rows = []; // indices of the nodes in the order shown
  #pool = [];
  #key = null;
  #lastRunning = -1;
  #children = { shape: null, lists: [] };

  constructor(panel, cell, run) {
    this.cell = cell;
    this.run = run;
    this.follow = h("input", { type: "checkbox", checked: true });
    this.filter = h("input", { type: "search", placeholder: "Find a node", "aria-label": "Find a node" });
    this.count = h("span", { class: "dim grow" });
    this.body = h("div", { class: "tree-body" });
    this.scroller = h("div", { class: "tree", role: "tree", tabindex: 0, "aria-label": "Tree" }, this.body);
    this.empty = h("p", { class: "empty" });
    panel.append(
      h("div", { class: "tools" }, this.filter, this.count,
        h("label", { class: "check", title: "Scroll to the running node" }, this.follow, "Follow")),
      this.scroller, this.empty,
    );
    this.filter.addEventListener("input", () => this.render());
    this.scroller.addEventListener("scroll", () => this.#draw());
    this.scroller.addEventListener("wheel", () => (this.follow.checked = false), { passive: true });
    this.scroller.addEventListener("touchmove", () => (this.follow.checked = false), { passive: true });
    this.scroller.addEventListener("click", (event) => this.#click(event));
    this.scroller.addEventListener("keydown", (event) => this.#press(event));
    new ResizeObserver(() => this.#draw()).observe(this.scroller);
  }

  render() {
    const tree = this.run.tree;
    this.scroller.hidden = !tree;
    this.empty.hidden = Boolean(tree);
    setText(this.empty, this.run.key ? "Reading the run…" : "No task has run yet. Start a job, or a skill in the window.");
    if (!tree) {
      setText(this.count, "");
      return;
    }
    if (this.#key !== this.run.key) {
      this.#collapsed.clear();
      this.#key = this.run.key;
      this.#lastRunning = -1;
    }
    this.#rowHeight = parseFloat(getComputedStyle(this.scroller).getPropertyValue("--row"));
    this.#flatten(tree);
    this.body.style.height = `${this.#rows.length * this.#rowHeight}px`;
    const count = tree.shape.ids.length;
    setText(this.count, this.#rows.length < count ? `${this.#rows.length} of ${count} nodes` : `${count} nodes`);
    if (this.follow.checked) this.#scrollToRunning(tree);
    this.#draw();
  }

  #rowHeight = 26;

  #childrenOf(shape) {
    if (this.#children.shape !== shape.parents) {
      const lists = shape.ids.map(() => []);
      shape.parents.forEach((parent, index) => parent >= 0 && lists[parent].push(index));
      this.#children = { shape: shape.parents, lists };
    }
    return this.#children.lists;
  }

  #isCollapsed(tree, index, depth) {
    const chosen = this.#collapsed.get(tree.shape.ids[index]);
    if (chosen !== undefined) return chosen;
    return tree.shape.ids.length > MANY && depth > COMPOUND_LIMIT && tree.rows[index][0] !== RUNNING;
  }

  #flatten(tree) {
    const children = this.#childrenOf(tree.shape);
    const text = this.filter.value.trim().toLowerCase();
    this.#rows = [];
    this.depths = [];
    const stack = [[0, 0]];
    while (stack.length) {
      const [index, depth] = stack.pop();
      if (!text || this.#matches(tree, index, text)) {
        this.#rows.push(index);
        this.depths.push(text ? 0 : depth);
      }
      if (!text && this.#isCollapsed(tree, index, depth)) continue;
      for (let i = children[index].length - 1; i >= 0; i--) stack.push([children[index][i], depth + 1]);
    }
  }

  #matches({ shape, rows }, index, text) {
    const state = this.cell.styles.node[rows[index][0]]?.word ?? "";
    return `${this.run.nodeName(index)} ${shape.types[index]} ${state} ${rows[index][4]}`.toLowerCase().includes(text);
  }

  #scrollToRunning(tree) {
    const last = this.#rows.findLast((index) => tree.rows[index][0] === RUNNING) ?? -1;
    if (last < 0 || last === this.#lastRunning) return;
    this.#lastRunning = last;
    this.#show(this.#rows.indexOf(last));
  }

  #show(position) {
    const top = position * this.#rowHeight;
    const { scrollTop, clientHeight } = this.scroller;
    if (top < scrollTop || top > scrollTop + clientHeight - 2 * this.#rowHeight)
      this.scroller.scrollTop = Math.max(0, top - clientHeight / 2);
  }

  #draw() {
    const tree = this.run.tree;
    if (!tree || !this.scroller.clientHeight) return;
    const first = Math.max(0, Math.floor(this.scroller.scrollTop / this.#rowHeight) - MARGIN);
    const wanted = Math.ceil(this.scroller.clientHeight / this.#rowHeight) + 2 * MARGIN;
    const end = Math.min(this.#rows.length, first + wanted);
    while (this.#pool.length < end - first) {
      const row = makeRow();
      this.#pool.push(row);
      this.body.append(row.element);
    }
    this.#pool.forEach((row, i) => {
      row.element.hidden = first + i >= end;
      if (first + i < end) this.#fill(row, tree, first + i);
    });
  }

  #fill(row, tree, position) {
    const index = this.#rows[position];
    const { shape, rows } = tree;
    const [state, , began, ended, message] = rows[index];
    const style = this.cell.styles.node[state] ?? { symbol: "?", role: "changed", word: "" };
    const isParent = this.#childrenOf(shape)[index].length > 0;
    const isOpen = isParent && !this.#isCollapsed(tree, index, this.depths[position]);
    const isGroup = index > 0 && !shape.types[index].includes(":");
    const { element } = row;
    element.style.transform = `translateY(${position * this.#rowHeight}px)`;
    element.style.setProperty("--depth", this.depths[position]);
    element.dataset.index = index;
    element.className = `row ${style.role}${isGroup ? " group" : ""}${shape.ids[index] === this.run.node ? " selected" : ""}`;
    element.setAttribute("aria-expanded", isParent ? isOpen : "");
    setText(row.twist, isParent ? (isOpen ? "▾" : "▸") : "");
    setText(row.symbol, style.symbol);
    row.symbol.title = style.word;
    setText(row.name, this.run.nodeName(index));
    const type = index && !isGroup && !shape.types[index].startsWith(":") ? localName(shape.types[index]) : "";
    setText(row.type, plain(type) === plain(shape.names[index]) ? "" : type);
    setText(row.time, began >= 0 ? duration((ended >= 0 ? ended : Math.max(this.run.elapsed, began)) - began) : "");
    setText(row.message, this.cell.withLabels(message, this.run.shownScene.elements));
  }

  #click(event) {
    const element = event.target.closest(".row");
    if (!element) return;
    const index = Number(element.dataset.index);
    if (event.target.closest(".twist") || event.detail === 2) this.#toggle(index);
    else this.run.selectNode(this.run.tree.shape.ids[index]);
    this.scroller.focus({ preventScroll: true });
  }

  #toggle(index, collapsed) {
    const tree = this.run.tree;
    const depth = this.depths[this.#rows.indexOf(index)];
    this.#collapsed.set(tree.shape.ids[index], collapsed ?? !this.#isCollapsed(tree, index, depth));
    this.follow.checked = false;
    this.render();
  }

  #press(event) {
    const tree = this.run.tree;
    if (!tree) return;
    const position = this.#rows.indexOf(this.run.index);
    const moves = { ArrowDown: 1, ArrowUp: -1, PageDown: 15, PageUp: -15, Home: -1e9, End: 1e9 };
    if (event.key in moves) {
      const next = Math.min(this.#rows.length - 1, Math.max(0, position + moves[event.key]));
      this.follow.checked = false;
      this.run.selectNode(tree.shape.ids[this.#rows[next]]);
      this.#show(next);
    } else if (position >= 0 && (event.key === "ArrowRight" || event.key === "ArrowLeft")) {
      this.#toggle(this.#rows[position], event.key === "ArrowLeft");
    } else return;
    event.preventDefault();
  }
}

// A name without what differs between the label and the type of a skill: pick_object, PickObject.
const plain = (name) => name.replaceAll("_", "").toLowerCase();

function makeRow() {
  const part = (name) => h("span", { class: name });
  const row = { twist: part("twist"), symbol: part("symbol"), name: part("name"), type: part("type"),
    message: part("message"), time: part("time") };
  const title = h("span", { class: "title" }, row.twist, row.symbol, row.name, row.type);
  row.element = h("div", { class: "row", role: "treeitem" }, title, row.message, row.time);
  return row;
}
