// The list of all jobs with search and filter, and the details of one.

import { notify, request } from "./cell.js";
import { openDialog } from "./dialogs.js";
import { duration, h, localName, moment, setText } from "./dom.js";
import { eventWord, goalTitle, jobRole, jobTitle, jobWord } from "./job_words.js";

const PAGE = 50;
// How long typing rests before the list is read again (ms).
const REST = 250;
const FILTERS = { all: ["All jobs", ""], queued: ["Queued", "&state=AllowedToStart&state=NotAllowedToStart"],
  running: ["Running", "&state=Running&state=Interrupted"], succeeded: ["Succeeded", "&outcome=succeeded&outcome=nothing_to_do"],
  failed: ["Failed", ["failed", "impossible", "timed_out", "lost"].map((outcome) => `&outcome=${outcome}`).join("")],
  cancelled: ["Cancelled", "&outcome=cancelled"] };
const DAY = 86400; // s
const PERIODS = { 1: "Last day", 7: "Last 7 days", 30: "Last 30 days", 0: "Any time" };

// Jobs of the list, also cleared ones, a page at a time.
export function openJobs(cell) {
  const option = ([value, [word]]) => h("option", { value }, word);
  const text = h("input", { type: "search", placeholder: "Id, description or goal", "aria-label": "Find a job", id: "find-job" });
  const filter = h("select", { "aria-label": "State", id: "job-filter" }, Object.entries(FILTERS).map(option));
  const period = h("select", { "aria-label": "Period" }, Object.entries(PERIODS).map(([days, word]) => h("option", { value: days, selected: days === "7" }, word)));
  const list = h("div", { class: "list" });
  const note = h("p", { class: "dim", role: "status" });
  const more = h("button", { type: "button", id: "more-jobs", hidden: true, onclick: () => read(after) }, "More");
  let after = null;
  let asked = 0;
  let timer = 0;

  async function read(from = null) {
    const number = ++asked;
    setText(note, "Reading…");
    const begin = Number(period.value) ? `&begin=${cell.now - DAY * Number(period.value)}` : "";
    const page = from === null ? "" : `&after=${from}`;
    const query = `cleared=true&limit=${PAGE}${page}${begin}${FILTERS[filter.value][1]}&text=${encodeURIComponent(text.value)}`;
    const isRead = await notify(request(`/api/jobs?${query}`).then(({ jobs, next }) => {
      if (number !== asked) return; // another filter was chosen meanwhile
      if (from === null) list.replaceChildren();
      list.append(...jobs.map((job) => row(cell, job)));
      after = next;
      more.hidden = next === null;
      setText(note, list.childElementCount ? "" : "No such jobs.");
    }));
    if (!isRead) setText(note, "The list could not be read.");
  }
  for (const input of [filter, period]) input.addEventListener("change", () => read());
  text.addEventListener("input", () => {
    clearTimeout(timer);
    timer = setTimeout(read, REST);
  });
  text.addEventListener("keydown", (event) => event.key === "Enter" && event.preventDefault());
  openDialog("jobs", "Jobs", h("h2", {}, "Jobs"), h("div", { class: "filters" }, text, filter, period), list, note, more);
  read();
  text.focus();
}

function row(cell, job) {
  const { started, ended } = job.response;
  return h("button", { type: "button", class: "job-row", onclick: () => openJob(cell, job.id) }, h("b", {}, jobTitle(cell, job)),
    h("span", { class: `chip ${jobRole(job)}` }, jobWord(job)),
    h("span", { class: "dim" }, `${job.id}, ${moment(job.created, cell.now)}${started && ended ? `, took ${duration(ended - started)}` : ""}`));
}

// What is known of a job: order, reason, plan, history, quality data and changes.
export async function openJob(cell, id) {
  const path = `/api/jobs/${encodeURIComponent(id)}`;
  let job, history;
  if (!(await notify(Promise.all([request(path), request(`${path}/history`)]).then(([a, b]) => ([job, { history }] = [a, b]))))) return;
  const { order, response } = job;
  const facts = (entries) => h("dl", { class: "facts" }, entries.filter(([, value]) => value !== "" && value != null)
    .map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))));
  const list = (title, tag, items) => (items.length ? [h("h3", {}, title), h(tag, {}, items.map((item) => h("li", {}, item)))] : []);
  const time = (seconds) => (seconds ? moment(seconds, cell.now) : "");
  const states = Object.fromEntries(response.steps.map((step) => [step.number, step]));
  const change = ({ author, lines }) => lines.map((line) => [cell.withLabels(line), h("span", { class: "dim" }, ` ${localName(author.replace(/^\//, ""))}`)]);
  openDialog("job-details", jobTitle(cell, job),
    h("div", { class: "top" }, h("h2", {}, jobTitle(cell, job)), h("span", { class: `chip ${jobRole(job)}` }, jobWord(job))),
    response.message && h("p", { class: "reason" }, cell.withLabels(response.message)),
    facts([["Id", job.id], ["Work master", order.work_master.replaceAll("_", " ")],
      ...Object.entries(order.parameters).map(([name, value]) => [name, cell.label(value)]),
      ["Goal", h("span", { title: job.goal }, goalTitle(cell, job.id, job.goal))], ["Priority", order.priority || ""], ["Due", order.due && moment(Date.parse(order.due) / 1000, cell.now)],
      ["Robots", response.robots.map((robot) => robot.slice(1)).join(", ")], ["Created by", job.author], ["Created", time(job.created)],
      ["Started", time(response.started)], ["Ended", time(response.ended)],
      ["Took", response.started && response.ended ? duration(response.ended - response.started) : ""],
      ...Object.entries(response.quality).map(([name, value]) => [name.replace(/\.[\w-]*:/, ": "), value === null ? "unknown" : String(value)])]),
    list("Plan", "ol", response.plan.map((step) => [h("b", {}, step.label), " ", Object.values(step.arguments).map((each) => cell.label(each)).join(", "),
      h("span", { class: "dim" }, ` ${step.robot.slice(1)} ${states[step.number]?.state ?? ""}`),
      states[step.number]?.message && h("div", { class: "dim" }, cell.withLabels(states[step.number].message))])),
    list("Notes", "ul", response.notes),
    list("Responses of others", "ul", job.received.map(({ id, author, time: at, description, states, values }) => [h("span", { class: "dim" }, `${time(at)} `),
      h("b", {}, description || id), ` ${[...states, ...Object.entries(values).map((each) => each.join(" "))].join(", ")}`, h("span", { class: "dim" }, ` ${author}`)])),
    list("History", "ul", history.map((entry) => [h("span", { class: "dim" }, `${time(entry.time)} `), eventWord(entry.method), " ",
      h("span", { class: "dim" }, `${entry.author}${entry.comment ? `: ${entry.comment}` : ""}`)])),
    list("Changes", "ul", response.changes.flatMap(change)));
}
