// Forces and other signals of the robots: the last 30 s of each, of the selected robot or of all.

import { h, keyed, localName, number, setText } from "./dom.js";

const SPAN = 30; // s
const HEIGHT = 72;

export class SignalsView {
  tables = ["signals", "elements"];
  #samples = new Map(); // by id: [time, low, high]

  constructor(panel, cell, run, selection) {
    this.cell = cell;
    this.run = run;
    this.selection = selection;
    this.robots = h("select", { id: "signals-of", "aria-label": "Signals of", onchange: () => selection.selectRobot(this.robots.value) });
    this.tools = h("div", { class: "tools" }, this.robots);
    this.list = h("div", { class: "signals" });
    this.empty = h("p", { class: "empty" }, "");
    panel.append(this.tools, this.list, this.empty);
  }

  get isMoving() {
    return !this.run.bagName;
  }

  // Keeps the values also while the panel is hidden.
  take(patch) {
    for (const id of Object.keys(patch ?? this.cell.document.signals)) {
      const signal = this.cell.document.signals[id];
      if (!signal) this.#samples.delete(id);
      else if (typeof signal.value === "number") {
        if (!this.#samples.has(id)) this.#samples.set(id, []);
        const samples = this.#samples.get(id);
        samples.push([signal.time, signal.low, signal.high]);
        while (samples[0][0] < signal.time - SPAN - 1) samples.shift(); // whatever the clock of this machine says
      }
    }
  }

  render() {
    const isBag = Boolean(this.run.bagName);
    const signals = isBag ? this.run.bagSignals : this.cell.document.signals;
    this.end = isBag ? this.run.sceneTime : this.cell.now;
    const shown = this.#ofRobot(signals);
    this.empty.hidden = shown.length > 0;
    setText(this.empty, Object.keys(signals).length ? `${localName(this.selection.robot.slice(1))} has no signals.`
      : "The cell has no signals.");
    keyed(this.list, shown, ([id]) => id, makeChart, (chart, [id, signal]) => {
      setText(chart.name, this.cell.label(id, this.run.shownScene.elements));
      const samples = isBag ? signal.samples : (this.#samples.get(id) ?? []);
      const value = isBag ? samples.findLast(([time]) => time <= this.end)?.[2] : signal.value;
      setText(chart.value, signal.problem ?? (value === undefined ? "no value yet" : `${number(value)} ${signal.unit}`));
      chart.samples = samples;
    });
    for (const chart of this.list.children) this.#draw(chart, chart.samples); // in the page, they have a size
  }

  // The signals of the selected robot, if the signals are of robots; with the choice of another one.
  #ofRobot(signals) {
    const entries = Object.entries(signals);
    const { robot } = this.selection;
    const names = [...new Set([...entries.map(([, signal]) => signal.robot), robot])].filter(Boolean).sort();
    const ofRobots = entries.some(([, signal]) => signal.robot);
    this.tools.hidden = !ofRobots || names.length < 2 && !robot;
    keyed(this.robots, ["", ...names], (name) => name, (name) => h("option", { value: name }, name ? localName(name.slice(1)) : "All robots"), () => {});
    if (this.robots.value !== robot) this.robots.value = robot;
    return ofRobots && robot ? entries.filter(([, signal]) => signal.robot === robot) : entries;
  }

  #draw(chart, samples) {
    const { canvas } = chart;
    const scale = devicePixelRatio;
    const [width, height] = [canvas.clientWidth * scale, HEIGHT * scale];
    if (canvas.width !== width) [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    const style = getComputedStyle(canvas); // the colours: `color` of the line, `border-color` of the zero line
    const visible = samples.filter(([time]) => time > this.end - SPAN && time <= this.end);
    if (!visible.length) return;
    let low = Math.min(...visible.map((each) => each[1]));
    let high = Math.max(...visible.map((each) => each[2]));
    setText(chart.range, `${number(low)} … ${number(high)}`);
    if (high - low < 1e-9) [low, high] = [low - 1, high + 1];
    const x = (time) => width * (1 - (this.end - time) / SPAN);
    const y = (value) => (height - 4 * scale) * (1 - (value - low) / (high - low)) + 2 * scale;
    context.strokeStyle = style.borderColor;
    if (low < 0 && high > 0) line(context, [[0, y(0)], [width, y(0)]]);
    context.strokeStyle = style.color;
    context.lineWidth = 1.5 * scale;
    context.lineJoin = "round";
    line(context, visible.flatMap(([time, lowest, highest]) => [[x(time), y(lowest)], [x(time), y(highest)]]));
  }
}

function line(context, points) {
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

function makeChart() {
  const chart = h("div", { class: "signal" });
  const part = (name, tag = "span") => (chart[name] = h(tag, { class: name }));
  chart.append(h("header", {}, part("name"), part("value")), part("canvas", "canvas"), part("range"));
  return chart;
}
