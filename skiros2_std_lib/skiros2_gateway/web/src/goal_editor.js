// A goal as rows of lists: subject, relation or property, object or value. What they offer, and what is wrong, comes from the
// gateway with each change (`skiros2_gateway.core.goal_form`).

import { request } from "./cell.js";
import { h, keyed, setText } from "./dom.js";

// Typing sends the goal after this pause (ms).
const TYPING = 200;
const EMPTY = { subject: {}, predicate: "", operator: "", object: {}, value: "", negated: false, text: "" };

export class GoalEditor {
  form = { goal: "", sentence: "", problem: "", lines: [], choices: {} };
  #asked = 0;
  #timer = 0;

  // onchange is called with each form from the gateway.
  constructor(onchange) {
    this.onchange = onchange;
    this.rows = h("div", { class: "goal-rows" });
    this.add = h("button", { type: "button", class: "small", id: "add-condition", onclick: () => this.#edit([...this.#lines, EMPTY]) }, "+ Add a condition");
    this.sentence = h("p", { class: "sentence" });
    this.problem = h("p", { class: "problems", id: "goal-problem" });
    this.text = h("textarea", { name: "goal", rows: 3, spellcheck: "false", "aria-label": "Goal as text",
      placeholder: "(skiros:contain demo:Tray-12 skiros:Product-14)", oninput: () => this.#soon({ goal: this.text.value }) });
    this.element = h("div", { class: "goal-editor" }, this.sentence, this.rows, h("div", {}, this.add),
      this.problem, h("details", { open: true }, h("summary", {}, "As text"), this.text));
    this.#send({ lines: [EMPTY] });
  }

  get goal() {
    return this.form.goal;
  }

  // Whether the goal can be planned.
  get isComplete() {
    return this.form.goal.trim() !== "" && !this.form.problem;
  }

  get #lines() {
    return this.form.lines ?? [];
  }

  #soon(edit) {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#send(edit), TYPING);
  }

  #edit(lines, chosen = null, isTyping = false) {
    this.form = { ...this.form, lines }; // the next edit builds on this one, also before the answer
    if (isTyping) this.#soon({ lines, chosen });
    else this.#send({ lines, chosen });
  }

  async #send(edit) {
    clearTimeout(this.#timer);
    const number = ++this.#asked;
    try {
      const form = await request("/api/goal/form", edit);
      if (number === this.#asked) this.#show(form);
    } catch (error) {
      if (number === this.#asked) setText(this.problem, error.message);
    }
  }

  #change(index, part, chosen = null, isTyping = false) {
    this.#edit(this.#lines.map((line, i) => (i === index ? { ...line, ...part } : line)), chosen, isTyping);
  }

  #show(form) {
    this.form = form.lines?.length === 0 ? { ...form, lines: [EMPTY] } : form;
    setText(this.sentence, form.sentence || "Choose an element, a relation or property, and an element or value.");
    this.sentence.classList.toggle("dim", !form.sentence);
    setText(this.problem, form.problem);
    if (document.activeElement !== this.text) this.text.value = form.goal;
    this.add.disabled = this.rows.inert = form.lines === null;
    if (form.lines !== null) this.#draw();
    this.onchange();
  }

  #draw() {
    const items = this.#lines.map((line, index) => ({ line, index }));
    keyed(this.rows, items, ({ index }) => index, ({ index }) => this.#makeRow(index), (row, { line }) => this.#fill(row, line));
  }

  #makeRow(index) {
    const row = h("div", { class: "goal-row" });
    const box = (name, label, take) => (row[name] = h("select", { "aria-label": label, "data-box": name,
      onchange: (event) => take(event.target.choices[event.target.value]) }));
    const subject = box("subject", "Subject", (choice) => this.#change(index, { subject: termOf(choice) }));
    const predicate = box("predicate", "Relation or property", (choice) => this.#change(index, { predicate: choice.name }, index));
    const object = box("object", "Object", (choice) => this.#change(index, { object: termOf(choice) }));
    row.negated = h("input", { type: "checkbox", onchange: () => this.#change(index, { negated: row.negated.checked }) });
    row.not = h("label", { class: "check", title: "The condition must not hold" }, row.negated, "not");
    row.operator = h("select", { "aria-label": "Operator", "data-box": "operator", onchange: () => this.#change(index, { operator: row.operator.value }) });
    row.value = h("span", { class: "goal-value" });
    row.take = (value, isTyping) => this.#change(index, { value }, null, isTyping);
    row.text = h("code", { title: "Rows cannot express this condition; edit it as text" });
    row.append(subject, row.not, predicate, row.operator, object, row.value, row.text,
      h("button", { type: "button", class: "small", title: "Removes this condition", "aria-label": "Remove this condition",
        onclick: () => this.#edit(this.#lines.filter((_, i) => i !== index)) }, "✕"));
    return row;
  }

  #fill(row, line) {
    const isProperty = line.operator !== "";
    for (const part of [row.subject, row.not, row.predicate]) part.hidden = Boolean(line.text);
    row.text.hidden = !line.text;
    setText(row.text, line.text);
    row.operator.hidden = row.value.hidden = !isProperty;
    row.object.hidden = isProperty || Boolean(line.text);
    if (line.text) return;
    const lists = this.form.choices;
    fillBox(row.subject, lists[line.subjects] ?? [], line.subject, "element");
    fillBox(row.predicate, lists[line.predicates] ?? [], { name: line.predicate }, "relation or property");
    fillBox(row.object, lists[line.objects] ?? [], line.object, "element");
    row.negated.checked = line.negated;
    if (!isProperty) return;
    if (row.operators !== line.operators.join()) {
      row.operators = line.operators.join();
      row.operator.replaceChildren(...line.operators.map((operator) => h("option", {}, operator)));
    }
    row.operator.value = line.operator;
    row.value.hidden = line.operator === "holds";
    fillValue(row, line);
  }
}

const termOf = ({ name, quantifier }) => ({ name, quantifier });

// Fills a list; what is chosen and not in it comes last.
function fillBox(box, listed, term, hint) {
  const isTerm = (choice) => choice.name === (term.name ?? "") && (choice.quantifier || "") === (term.quantifier ?? "");
  const choices = term.name && !listed.some(isTerm) ? [...listed, { ...term, text: [term.quantifier, term.name].join(" ").trim(), tip: "" }] : listed;
  const known = JSON.stringify(choices);
  if (box.known !== known) {
    [box.known, box.choices] = [known, choices];
    box.replaceChildren(h("option", { value: "", disabled: true }, hint),
      ...choices.map((choice, i) => h("option", { value: i, title: choice.tip, class: choice.faint ? "dim" : null }, choice.text)));
  }
  box.value = term.name ? String(choices.findIndex(isTerm)) : "";
}

function fillValue(row, { field, value }) {
  const known = JSON.stringify(field);
  if (row.field !== known) {
    row.field = known;
    row.value.replaceChildren(...makeValue(row, field));
  }
  const input = row.input;
  // What is being typed stays as it is.
  if (document.activeElement === input && (field.kind === "number" ? Number(input.value) : input.value) === value) return;
  input.value = String(value);
}

function makeValue(row, { kind, options, known, limits }) {
  const attributes = { "aria-label": "Value", "data-box": "value", title: limits.text };
  if (kind === "choice") {
    row.input = h("select", { ...attributes, onchange: () => row.take(row.input.value, false) },
      h("option", { value: "", disabled: true }, "value"), options.map((option) => h("option", {}, option)));
    return [row.input];
  }
  if (kind === "number") {
    row.input = h("input", { ...attributes, type: "number", step: "any", min: limits.minimum, max: limits.maximum, placeholder: limits.text || "number",
      oninput: () => row.take(row.input.value === "" ? "" : row.input.valueAsNumber, true) });
    return limits.unit ? [row.input, h("small", {}, limits.unit)] : [row.input];
  }
  const list = h("datalist", { id: `known-${crypto.getRandomValues(new Uint32Array(1))[0]}` }, known.map((text) => h("option", { value: text })));
  row.input = h("input", { ...attributes, placeholder: "value", list: list.id, oninput: () => row.take(row.input.value, true) });
  return [row.input, list];
}
