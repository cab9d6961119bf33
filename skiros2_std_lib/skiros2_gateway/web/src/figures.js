// Figures of a period: OEE and its factors by robot, durations by skill, jobs by outcome, the most frequent failures, and
// throughput and durations over time; also as CSV.

import { notify, request } from "./cell.js";
import { durations, throughput } from "./charts.js";
import { openDialog } from "./dialogs.js";
import { duration, firstLine, h, localName } from "./dom.js";

const HOUR = 3600; // s
const PERIODS = { 8: "Last 8 hours", 24: "Last 24 hours", 168: "Last 7 days", 720: "Last 30 days", 0: "All" };

const percent = (share) => `${(100 * share).toFixed(1)} %`;
const robot = (row) => localName(row.robot.slice(1));
// A share with a bar: the number is for those who read, the bar for those who compare.
const bar = (share) => h("span", { class: "share" }, percent(share), h("meter", { min: 0, max: 1, value: share, "aria-hidden": "true" }));

const TABLES = {
  robots: ["Robots", { Robot: robot, OEE: (row) => bar(row.oee), Availability: (row) => percent(row.availability),
    Quality: (row) => percent(row.quality), Utilisation: (row) => percent(row.utilisation), "Down": (row) => duration(row.down_s),
    Succeeded: (row) => row.succeeded, Failed: (row) => row.failed }],
  skills: ["Skills", { Skill: (row) => row.skill, Robot: robot, Runs: (row) => row.runs, Failed: (row) => row.failures,
    "Mean duration": (row) => duration(row.mean_s) }],
  jobs: ["Jobs", { Outcome: (row) => row.outcome.replaceAll("_", " "), Jobs: (row) => row.jobs }],
  failures: ["Most frequent failures", { Failure: (row) => h("span", { title: row.message }, firstLine(row.message) || "without a message"), Jobs: (row) => row.jobs }],
};

const CHARTS = { throughput: ["Throughput", throughput], durations: ["Durations over time", durations] };

export function openFigures(cell) {
  const period = h("select", { "aria-label": "Period", id: "figures-period", onchange: read },
    Object.entries(PERIODS).map(([hours, word]) => h("option", { value: hours, selected: hours === "24" }, word)));
  const content = h("div", { class: "figures", role: "status" });
  let asked = 0;

  async function read() {
    const number = ++asked;
    content.replaceChildren(h("p", { class: "dim" }, "Reading…"));
    const begin = Number(period.value) ? cell.now - HOUR * Number(period.value) : 0;
    const query = `begin=${Math.max(0, begin).toFixed(0)}`;
    const isRead = await notify(request(`/api/figures?${query}`).then((found) => {
      if (number === asked) content.replaceChildren(...Object.keys(CHARTS).map((name) => chart(name, found, query, cell.now)),
        ...Object.keys(TABLES).map((name) => table(name, found[name], query)));
    }));
    if (!isRead) content.replaceChildren(h("p", { class: "dim" }, "The figures could not be read."));
  }
  openDialog("figures-view", "Figures", h("div", { class: "top" }, h("h2", {}, "Figures"), period), content);
  read();
}

const csv = (name, title, query) =>
  h("a", { class: "csv", href: `/api/figures/${name}.csv?${query}`, download: `${name}.csv`, "aria-label": `${title} as CSV` }, "CSV");
const none = () => h("p", { class: "dim" }, "None in this period.");

function chart(name, found, query, now) {
  const [title, draw] = CHARTS[name];
  const isEmpty = name === "throughput" ? found.throughput.every((each) => each.succeeded + each.failed === 0) : !found.durations.length;
  return h("section", { "aria-label": title }, h("div", { class: "top" }, h("h3", {}, title), csv(name, title, query)),
    isEmpty ? none() : draw(found, now, duration));
}

function table(name, rows, query) {
  const [title, columns] = TABLES[name];
  const cells = (row) => Object.values(columns).map((value) => h("td", {}, value(row)));
  const head = h("thead", {}, h("tr", {}, Object.keys(columns).map((column) => h("th", { scope: "col" }, column))));
  return h("section", { "aria-label": title }, h("div", { class: "top" }, h("h3", {}, title), csv(name, title, query)),
    rows.length ? h("div", { class: "scroll", tabindex: 0 }, h("table", {}, head, h("tbody", {}, rows.map((row) => h("tr", {}, cells(row))))))
      : none());
}
