// Charts of figures over time. The tables beside them, and CSV, have the values.

import { h, moment } from "./dom.js";

const NAMESPACE = "http://www.w3.org/2000/svg";
const COLOURS = 6; // classes line-0 to line-5
const SIZE = 100; // of the drawing, which is stretched

// A frame with the largest value, and the times of the first and the last point.
function frame(label, most, times, now, content, legend) {
  return h("figure", { class: "chart" }, h("figcaption", {}, legend), h("span", { class: "most dim" }, most),
    h("div", { role: "img", "aria-label": label }, content),
    h("div", { class: "times dim" }, times.map((time) => h("span", {}, moment(time, now)))));
}

const key = (name, word) => h("span", { class: "key" }, h("i", { class: name }), word);

// Jobs that have ended within each step: succeeded below, failed on top.
export function throughput({ step, throughput: points }, now) {
  const most = Math.max(1, ...points.map((each) => each.succeeded + each.failed));
  const part = (name, value) => h("i", { class: name, style: `height: ${(100 * value) / most}%` });
  const bars = h("div", { class: "bars" }, points.map((each) => h("span", {
    title: `${moment(each.begin, now)}: ${each.succeeded} succeeded, ${each.failed} failed` },
  part("failure", each.failed), part("success", each.succeeded))));
  const times = [points[0].begin, points.at(-1).begin + step];
  return frame("Jobs that have ended over time", `${most} job${most > 1 ? "s" : ""}`, times, now, bars, [key("success", "succeeded"), key("failure", "failed")]);
}

// The mean durations of the skills with the most runs, a line for each.
export function durations({ step, throughput: times, durations: points }, now, format) {
  const runs = {};
  for (const { skill, runs: count } of points) runs[skill] = (runs[skill] ?? 0) + count;
  const skills = Object.keys(runs).sort((a, b) => runs[b] - runs[a]).slice(0, COLOURS);
  const shown = points.filter(({ skill }) => skills.includes(skill));
  const most = Math.max(1e-9, ...shown.map((each) => each.mean_s));
  const [begin, end] = [times[0].begin, times.at(-1).begin + step];
  const svg = document.createElementNS(NAMESPACE, "svg");
  svg.setAttribute("viewBox", `0 0 ${SIZE} ${SIZE}`);
  svg.setAttribute("preserveAspectRatio", "none");
  skills.forEach((skill, number) => {
    const line = document.createElementNS(NAMESPACE, "polyline");
    const at = shown.filter((each) => each.skill === skill).map((each) =>
      [SIZE * (each.begin + step / 2 - begin) / (end - begin), SIZE * (1 - 0.95 * each.mean_s / most)]);
    if (at.length === 1) at.push([at[0][0] + 1, at[0][1]]); // a point
    line.setAttribute("points", at.map((each) => each.map((value) => value.toFixed(2)).join(",")).join(" "));
    line.setAttribute("class", `line-${number}`);
    svg.append(line);
  });
  return frame("Mean durations of skills over time", format(most), [begin, end], now, svg, skills.map((skill, number) => key(`line-${number}`, skill)));
}
