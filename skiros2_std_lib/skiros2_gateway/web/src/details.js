// The bar of the shown run with its history, the details of a node, and the log.

import { causeOfRun } from "./causes.js";
import { GOALS, button, robotOf } from "./cell_panel.js";
import { request } from "./cell.js";
import { runPath } from "./run.js";
import { commandRobots } from "./commands.js";
import { clock, duration, h, keyed, setText } from "./dom.js";

// The states of ended tasks with a cause.
const CAUSED = ["failed", "preempted"];

const VERDICTS = { holds: ["✓", "success"], fails: ["✗", "failure"], unknown: ["?", "idle"] };

export class RunBar {
  tables = ["runs", "trees"];
  #causes = new Map();

  constructor(panel, cell, run) {
    this.cell = cell;
    this.run = run;
    this.chip = h("span", { class: "chip" });
    this.name = h("b");
    this.times = h("span", { class: "dim" });
    this.buttons = h("span", { class: "buttons" }, ["pause", "resume", "step", "stop"].map((action) =>
      button(action, () => this.#command(action))),
      button("why", () => this.#explain()));
    this.slider = h("input", { type: "range", min: 0, step: "any", "aria-label": "Time of the run", oninput: () => this.#seek() });
    this.at = h("span", { class: "at" });
    this.live = h("button", { class: "small", onclick: () => run.select(run.key) }, "Live");
    this.cause = h("p", { class: "cause", hidden: true });
    this.why = h("div", { class: "why", hidden: true });
    panel.append(h("div", { class: "line" }, this.chip, this.name, this.times, this.buttons),
      h("div", { class: "line history" }, this.slider, this.at, this.live), this.cause, this.why);
    this.panel = panel;
  }

  render() {
    const { run, cell } = this;
    const summary = run.summary;
    this.panel.hidden = !summary;
    if (!summary) return;
    const state = run.state ?? summary.state;
    const style = cell.styles.task[state] ?? { symbol: "?", role: "changed" };
    this.chip.className = `chip ${style.role}`;
    setText(this.chip, `${style.symbol} ${state}`);
    setText(this.name, summary.name);
    setText(this.times, `since ${clock(summary.start)}${robotOf(summary)}`);
    const total = (summary.end ?? cell.now) - summary.start;
    this.slider.max = total;
    if (document.activeElement !== this.slider || run.time === null) this.slider.value = run.elapsed;
    setText(this.at, `${duration(run.elapsed)}${run.time === null ? "" : ` of ${duration(total)}`}`);
    this.live.hidden = run.time === null;
    setText(this.live, run.hasEnded ? "To the end" : "Live");
    const isPaused = summary.state === "paused";
    const may = cell.mayCommand && !run.hasEnded && run.time === null;
    const shown = { pause: may && !isPaused, resume: may && isPaused, step: may && isPaused, stop: may,
      why: [...CAUSED, "lost"].includes(summary.state) && !run.bagName };
    for (const each of this.buttons.children) each.hidden = !shown[each.dataset.action];
    if (this.shownKey !== run.key) this.why.hidden = true;
    this.shownKey = run.key;
    const isFailure = CAUSED.includes(summary.state) && !run.bagName;
    if (isFailure && !this.#causes.has(run.key)) this.#readCause(run.key);
    setText(this.cause, (isFailure && this.#causes.get(run.key)) || "");
    this.cause.hidden = !this.cause.textContent;
  }

  // Why a run has failed, in one sentence: the first line of the manager's answer.
  async #readCause(key) {
    this.#causes.set(key, "");
    try {
      this.#causes.set(key, causeOfRun(await request(`${runPath(key)}/why`)));
    } catch {
      return; // the manager does not run any more; the tree has the messages
    }
    this.render();
  }

  #command(action) {
    const { key, summary } = this.run;
    const path = `${runPath(key)}/${action}`;
    return action === "step" || summary.robot === GOALS ? request(path, {}) : commandRobots(this.cell, action, [summary.robot], summary.task, path);
  }

  #seek() {
    const summary = this.run.summary;
    const isEnd = this.slider.valueAsNumber > 0.999 * Number(this.slider.max);
    this.run.select(this.run.key, isEnd && !this.run.bagName ? null : summary.start + this.slider.valueAsNumber);
  }

  async #explain() {
    const { text } = await request(`${runPath(this.run.key)}/why`);
    this.why.replaceChildren(h("pre", {}, text));
    this.why.hidden = !this.why.hidden;
  }
}

export class NodeDetails {
  tables = ["trees", "runs"];
  #status = null;
  #asked = 0;
  #answer = "";

  constructor(panel, cell, run) {
    this.cell = cell;
    this.run = run;
    this.title = h("h2");
    this.facts = h("dl", { class: "facts" });
    this.parameters = h("dl", { class: "facts parameters" });
    this.conditions = h("ul", { class: "conditions" });
    this.note = h("p", { class: "dim" });
    this.element = h("aside", { class: "details", hidden: true },
      h("header", {}, this.title, h("button", { class: "small", "aria-label": "Close", onclick: () => run.selectNode(null) }, "✕")),
      this.facts, h("h4", {}, "Conditions"), this.conditions, h("h4", {}, "Parameters"), this.parameters, this.note);
    panel.append(this.element);
    run.addEventListener("change", () => this.#read());
    setInterval(() => this.#read(), 1000);
  }

  render() {
    const { run, cell } = this;
    const index = run.index;
    this.element.hidden = index < 0;
    if (index < 0) return;
    const { shape, rows } = run.tree;
    const [state, code, began, ended, message] = rows[index];
    const style = cell.styles.node[state] ?? { symbol: "?", word: "unknown", role: "changed" };
    setText(this.title, run.nodeName(index));
    const facts = [["State", `${style.symbol} ${style.word}`], ["Type", shape.types[index]],
      ["Processor", shape.processors[index]], ["Message", cell.withLabels(message, run.shownScene.elements)], ["Code", code || ""],
      ["Started", began >= 0 ? `${clock(run.summary.start + began)}, after ${duration(began)}` : ""],
      ["Ran for", began >= 0 ? duration((ended >= 0 ? ended : run.elapsed) - began) : ""]];
    showFacts(this.facts, facts.filter(([, value]) => value !== ""));
    const status = this.#answer === this.#key ? this.#status : null;
    setText(this.note, status ? "" : run.hasEnded || run.time !== null
      ? "Values are known of nodes that were looked at while the task ran." : "Reading the values…");
    keyed(this.conditions, status?.conditions ?? [], (each) => `${each.stage} ${each.label}`, () => h("li"), (item, each) => {
      const [symbol, role] = VERDICTS[each.verdict];
      item.className = role;
      const text = `${symbol} ${each.stage}  ${each.text}${each.found ? `  (${each.found})` : ""}`;
      setText(item, text);
    });
    showFacts(this.parameters, (status?.params ?? []).map(({ key, value, source }) => [key, value ? `${this.cell.withLabels(value, run.shownScene.elements)}  (${source})` : "unset"]));
    for (const title of this.element.querySelectorAll("h4")) title.hidden = !title.nextElementSibling.children.length;
  }

  get #key() {
    return `${this.run.key} ${this.run.node} ${this.run.time ?? ""}`;
  }

  async #read() {
    const { run } = this;
    if (run.node === null || !run.key || this.element.offsetParent === null && this.#answer === this.#key) return;
    if (run.hasEnded && this.#answer === this.#key) return;
    if (Date.now() - this.#asked < 900 && this.#answer === this.#key) return;
    const key = this.#key;
    this.#asked = Date.now();
    try {
      const query = run.time === null ? "" : `?time=${run.time}`;
      this.#status = await request(`${runPath(run.key)}/nodes/${run.node}${query}`);
    } catch {
      this.#status = null; // the node is a control-flow node, or the task has ended
    }
    this.#answer = key;
    this.render();
  }
}

export function showFacts(list, facts) {
  keyed(list, facts, ([name]) => name, ([name]) => h("div", {}, h("dt", {}, name), h("dd")),
    (item, [, value]) => setText(item.lastChild, String(value)));
}

export class LogView {
  tables = ["trees"];
  #asked = "";

  constructor(panel, cell, run) {
    this.cell = cell;
    this.run = run;
    this.list = h("ol", { class: "log" });
    this.empty = h("p", { class: "empty" }, "No messages.");
    panel.append(this.list, this.empty);
  }

  render() {
    const run = this.run;
    // The log comes with the history; a live run's log is read again when the tree has changed.
    const asked = `${run.key} ${run.summary?.end ?? Math.floor(run.elapsed)}`;
    if (run.key && run.isLive && asked !== this.#asked) {
      this.#asked = asked;
      run.readHistory();
    }
    const lines = run.log.map((line, i) => ({ ...line, i }));
    this.empty.hidden = lines.length > 0;
    keyed(this.list, lines, (line) => `${run.key} ${line.i}`, () => h("li", {}, h("time"), h("b"), h("span")), (item, line) => {
      const style = this.cell.styles.node[line.state] ?? { symbol: "?", role: "changed" };
      item.className = style.role;
      setText(item.children[0], duration(Math.max(0, line.time - run.summary.start)));
      const index = run.tree?.shape.ids.indexOf(line.node) ?? -1;
      setText(item.children[1], `${style.symbol} ${index < 0 ? line.name : run.nodeName(index)}`);
      setText(item.children[2], this.cell.withLabels(line.message, run.shownScene.elements));
    });
  }
}
