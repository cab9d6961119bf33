// Robots, jobs, runs and recorded runs, with the commands for those with the role.

import { causeOfJob } from "./causes.js";
import { notify, request } from "./cell.js";
import { commandRobots } from "./commands.js";
import { openFigures } from "./figures.js";
import { openJob, openJobs } from "./jobs_dialog.js";
import { openJobDialog } from "./job_dialog.js";
import { hasFailed, jobRole, jobTitle, jobWord } from "./job_words.js";
import { clock, duration, h, keyed, localName, setText } from "./dom.js";

const ROBOT_ROLES = { busy: "running", idle: "idle", paused: "paused" };
const JOB_METHODS = {
  NotAllowedToStart: ["start", "cancel"], AllowedToStart: ["cancel"], Running: ["pause", "stop"],
  Interrupted: ["resume", "stop"], Ended: ["clear"], Aborted: ["clear"],
};
const JOB_ORDER = ["Running", "Interrupted", "AllowedToStart", "NotAllowedToStart", "Ended", "Aborted"];
const GONE = ["dropped", "failed", "stopped"]; // steps that another plan has replaced
const MOVES = { earlier: "↑", later: "↓" };
export const GOALS = "goals"; // the robot of runs that are goals

export class CellPanel {
  tables = ["cell", "connections", "jobs", "queue", "goals", "runs"];

  constructor(panel, cell, run, selection) {
    this.cell = cell;
    this.run = run;
    this.selection = selection;
    const list = () => h("div", { class: "list" });
    this.lost = h("div", { class: "lost" });
    this.robots = list();
    this.jobs = list();
    this.hidden = h("button", { class: "small more", hidden: true, onclick: () => openJobs(cell) });
    this.runs = list();
    this.bags = list();
    this.newJob = h("button", { class: "primary small", id: "new-job", hidden: true, onclick: () => openJobDialog(cell) }, "New job");
    this.runsTitle = h("h2", {}, "Runs");
    this.bagsBack = h("button", { class: "small", onclick: () => run.openBag("") }, "Back to the cell");
    this.now = h("div", {}, this.lost,
      h("header", {}, h("h2", {}, "Robots"), h("button", { class: "small", id: "figures", onclick: () => openFigures(cell) }, "Figures")), this.robots,
      h("header", {}, h("h2", {}, "Jobs"), h("span", { class: "grow" }),
        h("button", { class: "small", id: "all-jobs", onclick: () => openJobs(cell) }, "All jobs"), this.newJob), this.jobs, this.hidden);
    panel.append(
      this.now,
      h("header", {}, this.runsTitle, this.bagsBack), this.runs,
      h("details", { ontoggle: (event) => event.target.open && this.#readBags() },
        h("summary", {}, "Recorded runs"), this.bags),
    );
  }

  render() {
    const { cell, connections, jobs } = this.cell.document;
    const lost = Object.values(connections).filter((part) => !part.is_up);
    keyed(this.lost, lost, (part) => part.name, card, (element, part) => fill(element, "failure", part.name, "no connection",
      part.text || (part.since ? `lost at ${clock(part.since)}` : `${part.address} has not answered yet`)));
    this.newJob.hidden = !this.cell.mayCommand;
    keyed(this.robots, cell.robots ?? [], (robot) => robot.name, () => this.#makeRobot(), (e, robot) => this.#showRobot(e, robot));
    empty(this.robots, "No robot is connected.");
    const shown = Object.values(jobs).sort(compareJobs);
    keyed(this.jobs, shown, (job) => job.id, () => this.#makeJob(), (element, job) => this.#showJob(element, job));
    empty(this.jobs, "No jobs.");
    const hidden = this.cell.document.queue.hidden?.count ?? 0;
    this.hidden.hidden = hidden === 0;
    setText(this.hidden, `${hidden} more wait`);
    const runs = Object.entries(this.run.bagName ? this.run.bag : this.cell.document.runs);
    setText(this.runsTitle, this.run.bagName ? `Runs in ${this.run.bagName}` : "Runs");
    this.bagsBack.hidden = !this.run.bagName;
    this.now.hidden = Boolean(this.run.bagName);
    runs.sort(([, a], [, b]) => b.start - a.start);
    const shownRuns = runs.filter(([, summary]) => !summary.goal); // the steps of a goal are in its tree
    keyed(this.runs, shownRuns, ([key]) => key, () => this.#makeRun(), (element, entry) => this.#showRun(element, entry));
    empty(this.runs, "No task has run yet.");
  }

  #makeRobot() {
    const element = card();
    const robots = () => [element.item.name];
    clickable(element, () => {
      const isSelected = element.item.name === this.selection.robot;
      this.selection.selectRobot(isSelected ? "" : element.item.name);
      if (!isSelected) element.dispatchEvent(new CustomEvent("show-panel", { detail: "signals", bubbles: true }));
    });
    element.buttons.append(...["pause", "resume", "stop"].map((action) =>
      button(action, () => commandRobots(this.cell, action, robots()))));
    return element;
  }

  #showRobot(element, robot) {
    element.item = robot;
    element.classList.toggle("selected", robot.name === this.selection.robot);
    const tasks = robot.tasks.map((task) => task.label).join(", ");
    const { succeeded, failed } = robot.counters;
    const counts = `${succeeded} succeeded${failed ? `, ${failed} failed` : ""}`;
    fill(element, ROBOT_ROLES[robot.state] ?? "failure", localName(robot.name.slice(1)), robot.state.replaceAll("_", " "),
      robot.reason || tasks || counts);
    const isPaused = robot.state === "paused";
    this.#showButtons(element, { pause: tasks && !isPaused, resume: isPaused, stop: tasks });
  }

  #makeJob() {
    const element = card();
    clickable(element, () => openJob(this.cell, element.item.id));
    const methods = ["start", "pause", "resume", "stop", "cancel", "clear"];
    element.buttons.append(...Object.entries(MOVES).map(([action, symbol]) =>
      button(action, () => this.#move(element.item.id, action === "earlier" ? -1 : 1), symbol)));
    element.buttons.append(...methods.map((method) =>
      button(method, () => request(`/api/jobs/${element.item.id}/${method}`, {}))));
    element.addEventListener("keydown", (event) => {
      const step = event.altKey && { ArrowUp: -1, ArrowDown: 1 }[event.key];
      if (!step) return;
      event.preventDefault();
      notify(this.#move(element.item.id, step));
    });
    element.addEventListener("dragstart", () => (this.dragged = element.item.id));
    element.addEventListener("dragend", () => (this.dragged = null));
    element.addEventListener("dragover", (event) => this.dragged && element.draggable && event.preventDefault());
    element.addEventListener("drop", (event) => {
      const { top, height } = element.getBoundingClientRect();
      notify(this.#place(this.dragged, this.#queue.indexOf(element.item.id) + (event.clientY > top + height / 2 ? 1 : 0)));
    });
    return element;
  }

  // The ids of the jobs that may change places, in the order of starting.
  get #queue() {
    return Object.values(this.cell.document.jobs).filter(isQueued).sort(compareJobs).map(({ id }) => id);
  }

  #move(id, step) {
    const index = this.#queue.indexOf(id);
    return this.#place(id, step < 0 ? index - 1 : index + 2);
  }

  // Puts a job before the one at an index of the queue. Jobs that are not shown stay behind.
  async #place(id, index) {
    const queue = this.#queue;
    const isLast = index >= queue.length;
    if (index < 0 || !queue.includes(id) || queue[index] === id || (isLast && this.cell.document.queue.hidden)) return;
    await request(`/api/jobs/${encodeURIComponent(id)}/move`, { before: isLast ? "" : queue[index] });
  }

  #showJob(element, job) {
    element.item = job;
    const { response, state } = job;
    const goal = this.cell.document.goals[job.id];
    const steps = Object.values(goal?.steps ?? {});
    const done = steps.filter((step) => step.state === "succeeded").length;
    const count = goal?.plan.filter(({ number }) => !GONE.includes(goal.steps[number]?.state)).length;
    const progress = count ? `step ${Math.min(done + 1, count)} of ${count}` : (goal?.phase ?? "");
    const took = response.started ? `took ${duration(response.ended - response.started)}` : "";
    const doing = state === "Running" ? progress : took || job.id;
    const { sentence, details } = hasFailed(job) ? causeOfJob(response, (text) => this.cell.withLabels(text)) : { sentence: doing, details: doing };
    fill(element, jobRole(job), jobTitle(this.cell, job), jobWord(job), sentence, details);
    const allowed = JOB_METHODS[state];
    const queue = isQueued(job) && this.cell.mayCommand ? this.#queue : [job.id];
    element.draggable = queue.length > 1;
    const moves = { earlier: queue[0] !== job.id, later: queue.at(-1) !== job.id };
    this.#showButtons(element, { ...moves, ...Object.fromEntries(allowed.map((method) => [method, true])) });
  }

  #makeRun() {
    const element = card();
    clickable(element, () => {
      const [key, summary] = element.item;
      this.run.select(key, key.startsWith("bag/") ? summary.start : null);
      element.dispatchEvent(new CustomEvent("show-panel", { detail: "tree", bubbles: true }));
    });
    return element;
  }

  #showRun(element, entry) {
    element.item = entry;
    const [key, summary] = entry;
    const style = this.cell.styles.task[summary.state];
    const took = duration((summary.end ?? this.cell.now) - summary.start);
    fill(element, style.role, summary.name, `${style.symbol} ${summary.state}`,
      `${clock(summary.start)}, ${took}${robotOf(summary)}`);
    element.classList.toggle("selected", key === this.run.key);
  }

  #showButtons(element, wanted) {
    for (const each of element.buttons.children) each.hidden = !this.cell.mayCommand || !wanted[each.dataset.action];
    element.buttons.hidden = ![...element.buttons.children].some((each) => !each.hidden);
  }

  async #readBags() {
    try {
      const { bags } = await request("/api/live/bags");
      const open = async (name) => {
        const progress = setInterval(() => void this.#readBags(), 500); // that of the first time takes seconds
        const bag = await request(`/api/live/bags/${encodeURIComponent(name)}`).finally(() => clearInterval(progress));
        void this.#readBags();
        if (!Object.keys(bag.runs).length) throw new Error(bag.damage || `${name} has no runs`);
        this.run.openBag(name, bag);
        if (bag.damage) throw new Error(bag.damage);
      };
      keyed(this.bags, bags, (bag) => bag.name, (bag) => {
        const element = card();
        element.classList.add("clickable");
        element.addEventListener("click", () => notify(open(bag.name)));
        return element;
      }, (element, bag) =>
        fill(element, "idle", bag.name.replaceAll("~", "/").replaceAll("\\u{7e}", "~").replaceAll("\\u{5c}", "\\"), bag.progress !== undefined ? `${Math.round(100 * bag.progress)} % read` : bag.size < 1e6 ? `${Math.ceil(bag.size / 1e3)} kB` : `${(bag.size / 1e6).toFixed(1)} MB`, new Date(bag.time * 1000).toLocaleString()));
      empty(this.bags, "The gateway has no folder of bags (argument bags), or it is empty.");
    } catch (error) {
      notify(Promise.reject(error));
    }
  }
}

// The robot of a run, after a comma; a goal may have several.
export const robotOf = ({ robot }) => (robot === GOALS ? "" : `, ${robot.slice(1)}`);

// Running jobs first, then the queue in its order, then the ended ones, the newest first.
function compareJobs(a, b) {
  const part = ({ state }) => Math.floor(JOB_ORDER.indexOf(state) / 2);
  if (part(a) !== part(b)) return part(a) - part(b);
  if (part(a) === 2) return (b.response.ended ?? 0) - (a.response.ended ?? 0);
  if (a.state !== b.state) return JOB_ORDER.indexOf(a.state) - JOB_ORDER.indexOf(b.state);
  const index = a.rank.findIndex((each, i) => each !== b.rank[i]);
  return index < 0 ? a.rank.length - b.rank.length : index < b.rank.length ? a.rank[index] - b.rank[index] : 1;
}

const isQueued = ({ state, substate }) => state === "AllowedToStart" && substate !== "Loaded";

function card() {
  const element = h("div", { class: "card" });
  const part = (name) => (element[name] = h("span", { class: name }));
  element.append(part("title2"), part("chip"), part("detail"), part("buttons"));
  return element;
}

function clickable(element, open) {
  element.classList.add("clickable");
  element.tabIndex = 0;
  element.addEventListener("click", open);
  element.addEventListener("keydown", (event) => event.key === "Enter" && event.target === element && open());
}

function fill(element, role, title, word, detail, whole = detail) {
  setText(element.title2, title);
  setText(element.chip, word);
  setText(element.detail, detail);
  element.title2.title = title;
  element.detail.title = whole;
  element.chip.className = `chip ${role}`;
}

export function button(action, command, symbol = "") {
  const label = action[0].toUpperCase() + action.slice(1).replaceAll("_", " ");
  const onclick = (event) => {
    event.stopPropagation();
    event.target.disabled = true;
    notify(command()).finally(() => (event.target.disabled = false));
  };
  return h("button", { class: `small ${action}`, "data-action": action, onclick, ...(symbol && { "aria-label": label, title: label }) }, symbol || label);
}

// Shows a text while a list is empty.
function empty(list, text) {
  const isEmpty = !list.querySelector(".card");
  list.note ??= h("p", { class: "empty" });
  setText(list.note, text);
  if (isEmpty) list.append(list.note);
  else list.note.remove();
}
