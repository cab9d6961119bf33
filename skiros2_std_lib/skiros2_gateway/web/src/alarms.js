// Alarms: a button in the header with their number, which the title has too, their sound, and the list in which a person
// acknowledges them.

import { title } from "./approvals.js";
import { notify, request } from "./cell.js";
import { show } from "./dialogs.js";
import { h, keyed, localName, moment, setText } from "./dom.js";
import { jobTitle } from "./job_words.js";
import { openJob } from "./jobs_dialog.js";
import { AlarmSound } from "./sound.js";

const KINDS = { job: ["Job failed", "failure"], connection: ["No connection", "failure"], robot: ["Robot stopped", "failure"],
  approval: ["Approval waits", "paused"] };

export class AlarmsView {
  tables = ["alarms", "jobs", "elements"];
  isMoving = false;

  constructor(cell) {
    this.cell = cell;
    this.button = h("button", { class: "small", id: "alarms", onclick: () => show(this.dialog) });
    this.sound = new AlarmSound();
    this.list = h("div", { class: "list" });
    this.all = h("button", { type: "button", class: "small", id: "acknowledge-all", onclick: () => this.#acknowledge() }, "Acknowledge all");
    this.dialog = h("dialog", { class: "approvals", "aria-label": "Alarms" }, h("form", { method: "dialog" },
      h("div", { class: "top" }, h("h2", {}, "Alarms"), this.all), this.list, h("p", { class: "dim none" }, "No alarms."),
      h("div", { class: "end" }, this.sound.switch, h("span", { class: "grow" }), h("button", { id: "close-alarms" }, "Close"))));
    document.body.append(this.dialog);
  }

  render() {
    const isNew = (alarm) => !alarm.acknowledged;
    const alarms = Object.entries(this.cell.document.alarms)
      .sort(([, a], [, b]) => Number(isNew(b)) - Number(isNew(a)) || b.since - a.since);
    const unseen = alarms.filter(([, alarm]) => isNew(alarm)).map(([id]) => id);
    const count = unseen.length;
    this.sound.follow(unseen);
    document.title = count ? `(${count}) SkiROS2` : "SkiROS2";
    this.button.classList.toggle("alarm", alarms.length > 0);
    this.button.classList.toggle("new", count > 0);
    setText(this.button, count ? `${count} alarm${count === 1 ? "" : "s"}` : "Alarms");
    this.all.hidden = count === 0 || !this.cell.mayCommand;
    this.list.nextElementSibling.hidden = alarms.length > 0;
    keyed(this.list, alarms, ([id]) => id, ([id]) => this.#make(id), (element, [, alarm]) => this.#show(element, alarm));
  }

  #acknowledge(alarms = Object.entries(this.cell.document.alarms).filter(([, alarm]) => !alarm.acknowledged).map(([id]) => id)) {
    return notify(request("/api/alarms/acknowledge", { alarms }));
  }

  #make(id) {
    const element = h("section", { class: "approval" });
    const part = (name, tag = "span", attributes = {}) => (element[name] = h(tag, attributes));
    element.answer = h("button", { type: "button", class: "small", "data-action": "acknowledge", onclick: () => this.#acknowledge([id]) }, "Acknowledge");
    element.details = h("button", { type: "button", class: "small", onclick: () => openJob(this.cell, element.details.value) }, "Details");
    element.append(h("header", {}, part("source", "b"), part("since", "span", { class: "dim" })),
      h("p", {}, part("kind"), " ", part("text")), h("div", { class: "buttons" }, part("seen", "span", { class: "dim" }), element.details, element.answer));
    return element;
  }

  #source({ kind, source }) {
    const { jobs, approvals } = this.cell.document;
    if (kind === "job" && jobs[source]) return jobTitle(this.cell, jobs[source]);
    if (kind === "approval") return !approvals[source] ? "Request of an agent" : title(approvals[source], (text) => this.cell.withNames(text));
    return localName(source.replace(/^\//, ""));
  }

  #show(element, alarm) {
    const [word, role] = KINDS[alarm.kind];
    setText(element.source, this.#source(alarm));
    setText(element.since, alarm.since ? moment(alarm.since, this.cell.now) : "");
    setText(element.kind, alarm.kind === "approval" && alarm.cleared ? "Not answered" : word);
    element.kind.className = `chip ${role}`;
    setText(element.text, this.cell.withLabels(alarm.text));
    const seen = alarm.acknowledged;
    const ending = alarm.kind === "approval" ? "ended without an answer" : "cleared";
    const over = alarm.cleared ? `${ending} ${moment(alarm.cleared, this.cell.now)}, not acknowledged` : "";
    setText(element.seen, seen ? `acknowledged by ${seen.user}, ${moment(seen.time, this.cell.now)}` : over);
    element.details.hidden = alarm.kind !== "job";
    element.details.value = alarm.source;
    element.answer.hidden = Boolean(seen) || !this.cell.mayCommand;
  }
}
