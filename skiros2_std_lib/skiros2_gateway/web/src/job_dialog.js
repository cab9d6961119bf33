// The dialog that makes a job: a work master with its parameters, or a goal; when it starts, how urgent it is, and by whom.

import { causeOfNoPlan } from "./causes.js";
import { notify, request } from "./cell.js";
import { show as showDialog } from "./dialogs.js";
import { duration, h, localName, notice, setText } from "./dom.js";
import { GoalEditor } from "./goal_editor.js";

const OWN_GOAL = "";
// How long a plan may take (s).
const PLAN_LIMIT = 120;

export async function openJobDialog(cell) {
  let masters;
  if (!(await notify(request("/api/work_masters").then((answer) => (masters = answer.work_masters))))) return;
  if (document.querySelector("dialog.job")) return; // of an earlier click
  const choice = h("select", { id: "work-master" },
    masters.map((master) => h("option", { value: master.id }, master.description || master.id.replaceAll("_", " "))),
    h("option", { value: OWN_GOAL }, "A goal…"));
  const fields = h("div", { class: "fields" });
  const robots = (cell.document.cell.robots ?? []).map(({ name }) =>
    h("label", { class: "check" }, h("input", { type: "checkbox", name: "robots", value: name }), localName(name.slice(1))));
  const when = h("details", { class: "when" }, h("summary", {}, "Priority, times, robots"), h("div", { class: "fields columns" },
    entry("priority", "Priority", h("input", { type: "number", step: 1, min: -32768, max: 32767, placeholder: "0" }), "the highest first"),
    entry("due", "Due", h("input", { type: "datetime-local" }), "of one priority, the earliest first"),
    entry("earliest_start", "Earliest start", h("input", { type: "datetime-local" })),
    entry("description", "Description", h("input", { maxlength: 1000 }))),
    h("fieldset", { "data-where": "robots" }, h("legend", {}, "Robots"), robots, h("small", {}, "none: any robot"), problemsOf("robots")),
    h("label", { class: "check" }, h("input", { type: "checkbox", name: "start", checked: true }), "May start at once"));
  const problems = h("ul", { class: "problems" });
  const preview = h("div", { class: "preview" });
  const form = h("form", { method: "dialog" },
    h("h2", {}, "New job"), entry("work_master", "Job", choice), fields, when, preview, problems,
    h("footer", {}, h("button", { type: "button", onclick: () => dialog.close() }, "Cancel"),
      h("button", { type: "button", id: "make-plan", onclick: plan }, "Plan"),
      h("button", { type: "submit", class: "primary", id: "start-job" }, "Start")));
  const dialog = h("dialog", { class: "job", "aria-label": "New job", onclose: () => close() }, form);

  // Elements may arrive, or change, while the dialog is open.
  const refresh = ({ detail: patch }) => {
    if (!patch || patch.elements) for (const input of fields.querySelectorAll("select")) input.refresh?.();
  };
  function close() {
    cell.removeEventListener("change", refresh);
    dialog.remove();
  }
  cell.addEventListener("change", refresh);
  let master = null;
  let editor = null; // of a goal

  function showFields() {
    master = masters.find((each) => each.id === choice.value) ?? null;
    editor = master ? null : new GoalEditor(showButtons);
    fields.replaceChildren(...(master ? master.parameters.map((parameter) => field(cell, parameter)) : [editor.element]));
    dialog.classList.toggle("wide", !master);
    showButtons();
    preview.replaceChildren();
    showProblems([]);
  }

  function showButtons() {
    for (const id of ["make-plan", "start-job"]) form.querySelector(`#${id}`).disabled = editor !== null && !editor.isComplete;
  }

  function order() {
    const found = editor ? { goal: editor.goal } : { work_master: master.id, parameters: valuesIn(fields) };
    const chosen = robots.map((label) => label.firstChild).filter((input) => input.checked).map((input) => input.value);
    return { ...found, ...valuesIn(when), robots: chosen };
  }

  async function plan() {
    preview.replaceChildren(h("p", { class: "dim" }, "Planning…"));
    showProblems([]);
    const goal = editor ? editor.goal : filled(master, order().parameters);
    try {
      const answer = await request("/api/plan", { goal }, "POST", PLAN_LIMIT);
      const count = answer.plan.length;
      const { sentence, details } = count ? {} : causeOfNoPlan(answer);
      preview.replaceChildren(
        h("p", {}, count ? `${count} step${count > 1 ? "s" : ""}, ${duration(answer.makespan)}` : sentence),
        ...(details ? [h("details", {}, h("summary", {}, "Details"), h("pre", {}, details))] : []),
        h("ol", {}, answer.plan.map((step) => h("li", {}, h("b", {}, step.label), " ",
          Object.values(step.arguments).map((id) => cell.name(id)).join(", ")))));
    } catch (error) {
      preview.replaceChildren();
      show(error);
    }
  }

  const show = (error) => showProblems(error.problems?.length ? error.problems : [{ message: error.message }]);

  // Each problem at its field; those of no field below.
  function showProblems(found) {
    for (const note of form.querySelectorAll(".problems[id]")) setText(note, "");
    for (const input of form.querySelectorAll("[aria-invalid]")) input.removeAttribute("aria-invalid");
    const others = [];
    for (const { where = "", message } of found) {
      const field = form.querySelector(`[data-where="${CSS.escape(where)}"], [data-where="${CSS.escape(where.replace(/\.\d+$/, ""))}"]`);
      if (!field) {
        others.push(h("li", {}, where ? h("b", {}, `${where}: `) : "", message));
        continue;
      }
      field.closest("details")?.setAttribute("open", "");
      field.querySelector("input, select")?.setAttribute("aria-invalid", "true");
      setText(field.querySelector(".problems"), message);
    }
    problems.replaceChildren(...others);
    form.querySelector("[aria-invalid]")?.focus();
  }

  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      await request("/api/jobs", { id: `${cell.user}-${crypto.getRandomValues(new Uint32Array(2)).join("")}`, ...order() });
      dialog.close();
      notice(form.elements.start.checked ? "The job is in the queue." : "The job is stored.", "success");
    } catch (error) {
      show(error);
    }
  });
  choice.addEventListener("change", showFields);
  showFields();
  document.body.append(dialog);
  showDialog(dialog);
  choice.focus();
}

function field(cell, parameter) {
  const basic = ["string", "number", "integer", "boolean"].includes(parameter.type);
  const choices = parameter.choices?.length ? parameter.choices : parameter.type === "boolean" ? ["true", "false"] : null;
  let input;
  if (!basic) {
    input = h("select", {}, elementOptions(cell, parameter.type));
    input.refresh = () => {
      const value = input.value;
      input.replaceChildren(...elementOptions(cell, parameter.type).flat());
      if (value) input.value = value;
    };
  } else if (choices) input = h("select", {}, choices.map((value) => h("option", { value }, String(value))));
  else {
    const type = parameter.type === "number" || parameter.type === "integer" ? "number" : "text";
    input = h("input", { type, min: parameter.minimum, max: parameter.maximum, step: type === "text" ? null : parameter.type === "integer" ? 1 : "any" });
  }
  input.dataset.type = parameter.type;
  if (parameter.default != null) input.value = parameter.default;
  const { id, unit, description } = parameter;
  return entry(`parameters.${id}`, unit ? `${id} (${unit})` : id, input, [description, limits(parameter)].filter(Boolean).join("; "));
}

const problemsOf = (where) => h("small", { class: "problems", id: `problems-${where}`, role: "alert" });

// A field with its label, a note, and room for what is wrong with it. `where` is the path of the order's field.
function entry(where, label, input, note = "") {
  input.name = where.replace("parameters.", "");
  input.setAttribute("aria-describedby", `problems-${where}`);
  return h("label", { "data-where": where }, label, input, note && h("small", {}, note), problemsOf(where));
}

function limits({ minimum, maximum }) {
  if (minimum != null && maximum != null) return `${minimum} to ${maximum}`;
  return minimum != null ? `at least ${minimum}` : maximum != null ? `at most ${maximum}` : "";
}

// The values of the fields that have one, by name.
function valuesIn(element) {
  const inputs = [...element.querySelectorAll("[name]")].filter((input) => input.value !== "");
  return Object.fromEntries(inputs.map((input) => [input.name, valueOf(input)]));
}

// Elements of a class; then other physical ones, for the page does not know the subclasses. The gateway checks the choice.
function elementOptions(cell, type) {
  const elements = Object.values(cell.document.elements).sort((a, b) => a.label.localeCompare(b.label));
  const option = (element) => h("option", { value: element.id }, element.label || element.id);
  const others = elements.filter((element) => element.type !== type && "skiros:BaseFrameId" in element.properties);
  return [elements.filter((element) => element.type === type).map(option),
    h("optgroup", { label: "Other elements" }, others.map(option))];
}

function valueOf(input) {
  if (input.type === "checkbox") return input.checked;
  if (input.type === "datetime-local") return new Date(input.value).toISOString();
  if (input.type === "number") return Number(input.value);
  return input.dataset.type === "boolean" ? input.value === "true" : ["number", "integer"].includes(input.dataset.type) ? Number(input.value) : input.value;
}

// The goal of a work master with its values, as the gateway fills it.
function filled(master, values) {
  return master.goal.replace(/\{(\w+)\}/g, (_, name) => {
    const value = values[name] ?? "";
    return typeof value === "string" ? `"${value}"` : String(value);
  });
}
