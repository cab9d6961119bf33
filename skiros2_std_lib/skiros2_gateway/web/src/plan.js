// The plan of a goal as a Gantt chart: each step as it was planned, and as it was carried out.

import { duration, firstLine, h, keyed, setText } from "./dom.js";

const ROLES = { running: "running", succeeded: "success", failed: "failure", stopped: "paused", dropped: "idle" };
const TICKS = [0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200, 21600];

export class PlanView {
  tables = ["goals"];
  isMoving = false;
  #chosen = "";

  constructor(panel, cell, run) {
    this.cell = cell;
    this.run = run;
    this.select = h("select", { "aria-label": "Goal", onchange: () => this.#choose() });
    this.message = h("p", { class: "dim" });
    this.axis = h("div", { class: "axis" });
    this.rows = h("div", { class: "steps" });
    this.now = h("div", { class: "now" });
    this.chart = h("div", { class: "gantt" }, this.axis, this.rows, h("div", { class: "overlay" }, this.now));
    this.legend = h("p", { class: "legend dim" }, h("i", { class: "planned" }), "planned ", h("i", { class: "actual" }), "carried out");
    this.empty = h("p", { class: "empty" }, "No goal has been planned yet.");
    panel.append(h("div", { class: "tools" }, this.select), this.message, this.chart, this.legend, this.empty);
  }

  #choose() {
    this.#chosen = this.select.value;
    this.render();
  }

  render() {
    const { goals } = this.run;
    const ids = Object.keys(goals).sort((a, b) => goals[b].start - goals[a].start);
    const id = this.#chosen in goals ? this.#chosen : ids[0];
    const goal = goals[id];
    for (const part of [this.select, this.chart, this.legend, this.message]) part.hidden = !goal;
    this.empty.hidden = Boolean(goal);
    this.isMoving = false;
    if (!goal) return;
    keyed(this.select, ids, (each) => each, (each) => h("option", { value: each }), (option, each) => setText(option, this.#title(each)));
    this.select.value = id;
    const message = this.cell.withLabels(goal.message, this.run.shownScene.elements);
    setText(this.message, firstLine(message));
    this.message.title = message;
    this.#draw(goal);
  }

  #title(id) {
    const job = this.run.bagName ? null : this.cell.document.jobs[id];
    const { goal, title } = this.run.goals[id];
    if (!job?.order.work_master) return title || this.cell.withLabels(goal, this.run.shownScene.elements) || id;
    const values = Object.values(job.order.parameters).map((value) => this.cell.label(value)).join(", ");
    return `${job.order.work_master.replaceAll("_", " ")}: ${values}`;
  }

  #draw(goal) {
    // The plan's time 0: when its first step began. The steps of a later plan are scheduled from that plan's start.
    const plan = goal.plan;
    const began = (step) => goal.steps[step.number]?.began;
    const offsets = offsetsOf(plan, began, goal.start);
    const start = Math.min(goal.start, ...plan.map((step) => began(step) ?? Infinity));
    const now = this.run.sceneTime ?? this.cell.now;
    const isRunning = !this.run.bagName && Object.values(goal.steps).some((step) => step.state === "running");
    this.isMoving = isRunning;
    const ends = plan.map((step, i) => Math.max(offsets[i] + step.end, goal.steps[step.number]?.ended ?? 0));
    const span = Math.max(1, Math.max(...ends, isRunning ? now : 0) - start);
    const percent = (time) => `${(100 * (time - start)) / span}%`;
    const tick = TICKS.find((each) => span / each <= 8) ?? 86400;
    const marks = Array.from({ length: Math.floor(span / tick) + 1 }, (_, i) => i * tick).filter((mark) => mark < 0.94 * span); // not cut
    keyed(this.axis, marks, (mark) => mark, (mark) => h("span", {}, mark < 60 ? `${mark} s` : duration(mark)),
      (element, mark) => (element.style.left = `${(100 * mark) / span}%`));
    this.now.hidden = now < start || now > start + span;
    this.now.style.left = percent(now);
    const items = plan.map((step, i) => ({ step, offset: offsets[i] }));
    keyed(this.rows, items, ({ step }) => step.number, makeStep, (row, { step, offset }) => {
      const known = goal.steps[step.number];
      const style = ROLES[known?.state] ?? "idle";
      row.className = `step ${style}`;
      setText(row.label, step.label);
      setText(row.names, this.#names(step));
      setText(row.robot, step.robot.slice(1));
      place(row.planned, percent(offset + step.start), percent(offset + step.end));
      row.actual.hidden = !known?.began;
      if (!known?.began) return;
      const end = known.ended ?? Math.max(known.began, now);
      place(row.actual, percent(known.began), percent(end));
      row.title = `${step.label}: ${known.state}, ${duration(end - known.began)}, planned ${duration(step.end - step.start)}`
        + (known.message ? `\n${known.message}` : "");
      setText(row.took, duration(end - known.began));
    });
  }

  // The elements that make the difference: not the robot and its parts.
  #names(step) {
    const own = new Set(["Robot", "Arm", "Gripper", "Camera", "StartLocation"]);
    return Object.entries(step.arguments).filter(([key]) => !own.has(key)).map(([, id]) => this.cell.label(id, this.run.shownScene.elements)).join(", ");
  }
}

// The time (s since the epoch) at which each step's schedule counts from 0.
function offsetsOf(plan, began, fallback) {
  let offset = fallback;
  let isKnown = false;
  let last = -Infinity;
  return plan.map((step) => {
    if (step.start < last) isKnown = false; // the first step of another plan
    last = Math.max(step.start, 0);
    if (!isKnown && began(step) !== undefined) [offset, isKnown] = [began(step) - step.start, true];
    return offset;
  });
}

function place(element, left, right) {
  element.style.left = left;
  element.style.width = `calc(${right} - ${left})`;
}

function makeStep() {
  const row = h("div");
  const part = (name, tag = "span") => (row[name] = h(tag, { class: name }));
  row.append(h("span", { class: "step-title" }, part("label"), part("names"), part("robot")),
    h("span", { class: "track" }, part("planned"), part("actual")));
  row.actual.append((row.took = h("span")));
  return row;
}
