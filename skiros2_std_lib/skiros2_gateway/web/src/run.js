// The run that is shown: live, or at a time of its history.

import { request } from "./cell.js";

// The route of a run; the name of its bag may have any character.
export function runPath(key) {
  return `/api/live/runs/${key.split("/").map(encodeURIComponent).join("/")}`;
}

// Dispatches `change` when another run or time is shown, or a part of the history has arrived.
export class ShownRun extends EventTarget {
  key = null;
  time = null; // s since the epoch; null: live
  node = null; // the id of the selected node
  bag = {}; // the runs of an open bag, by key
  bagGoals = {};
  bagSignals = {};
  bagName = "";
  scene = null; // elements, frames and bodies at the shown time; null: those of the live document
  #history = null;
  #isAsking = false;
  #isFollowing = true;

  constructor(cell) {
    super();
    this.cell = cell;
  }

  get summary() {
    return this.bag[this.key] ?? this.cell.document?.runs[this.key] ?? null;
  }

  get isLive() {
    return this.time === null && this.key in (this.cell.document?.trees ?? {});
  }

  // {shape, rows}, or null before it has arrived.
  get tree() {
    return this.isLive ? this.cell.document.trees[this.key] : (this.#history?.tree ?? null);
  }

  get log() {
    return this.#history?.log ?? [];
  }

  // The state of the task at the shown time.
  get state() {
    return this.isLive ? this.summary?.state : (this.#history?.state ?? this.summary?.state);
  }

  get hasEnded() {
    return !this.summary || this.summary.end !== undefined;
  }

  // The shown time, as s after the start of the run.
  get elapsed() {
    const summary = this.summary;
    if (!summary) return 0;
    return (this.time ?? summary.end ?? this.cell.now) - summary.start;
  }

  get index() {
    return this.tree ? this.tree.shape.ids.indexOf(this.node) : -1;
  }

  // The name of a node for people: a task's number says nothing. The details have type and processor.
  nodeName(index) {
    if (!index && this.summary) return this.summary.name;
    const { names, processors } = this.tree.shape;
    const symbol = ` ${processors[index]}`; // of control-flow nodes: parallel |fs|
    return symbol !== " " && names[index].endsWith(symbol) ? names[index].slice(0, -symbol.length) : names[index];
  }

  select(key, time = null) {
    const isOther = key !== this.key;
    if (isOther) [this.node, this.#history] = [null, null];
    [this.key, this.time] = [key, time];
    if (this.sceneTime === null) this.scene = null;
    this.#isFollowing = time === null && !this.hasEnded;
    this.#changed();
    if (key && !this.isLive) this.readHistory();
  }

  // The time of the shown scene; null: now.
  get sceneTime() {
    return this.time ?? (this.key in this.bag ? this.summary.end : null) ?? null;
  }

  // The document with the elements and robots at the shown time.
  get shownScene() {
    return this.scene ?? this.cell.document;
  }

  // The goals of the cell, or of the open bag.
  get goals() {
    return this.bagName ? this.bagGoals : this.cell.document.goals;
  }

  selectNode(id) {
    this.node = id;
    this.#changed();
  }

  // Shows the newest run when the shown one has ended; a run that was selected after its end stays.
  refresh() {
    const goal = this.summary?.goal; // of a task that has turned out to be a step of one
    if (goal) this.select(goal);
    const runs = Object.entries(this.cell.document.runs).filter(([, summary]) => !summary.goal);
    const newest = runs.reduce((best, entry) => (!best || entry[1].start >= best[1].start ? entry : best), null);
    const isGone = this.key && !this.summary;
    if (newest && (!this.key || isGone || (this.#isFollowing && this.hasEnded && newest[0] !== this.key))) {
      this.select(newest[0]);
      this.#isFollowing = true;
    } else if (isGone) this.select(null);
  }

  // Opens a bag, with its runs, goals and signals by key; "" closes it.
  openBag(name, { runs = {}, goals = {}, signals = {} } = {}) {
    [this.bagName, this.bag, this.bagGoals, this.bagSignals] = [name, runs, goals, signals];
    const first = Object.keys(runs).find((key) => !runs[key].goal) ?? null; // a goal before its steps
    if (first) this.select(first, runs[first].start);
    else if (!name && this.key?.startsWith("bag/")) {
      this.select(null);
      this.refresh();
    }
    this.#changed();
  }

  // Reads the shown time; one request at a time, the last one counts.
  async readHistory() {
    if (this.#isAsking) return;
    this.#isAsking = true;
    try {
      let asked;
      do {
        asked = `${this.key} ${this.time}`;
        const query = this.time === null ? "" : `?time=${this.time}`;
        const path = runPath(this.key);
        const at = this.sceneTime;
        const asks = [request(path + query), at === null ? null : request(`${path}/scene?time=${at}`)];
        const [answer, scene] = await Promise.all(asks);
        if (asked.startsWith(`${this.key} `)) this.#history = answer;
        this.scene = this.sceneTime === null ? null : scene;
        this.#changed();
      } while (this.key && asked !== `${this.key} ${this.time}`);
    } catch {
      [this.#history, this.scene] = [null, null]; // the run is no longer kept, or the gateway is away
    } finally {
      this.#isAsking = false;
    }
  }

  #changed() {
    this.dispatchEvent(new Event("change"));
  }
}
