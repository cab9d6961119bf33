// The dialog that starts a job: a work master with its parameters, or a goal.

import { causeOfNoPlan } from "./causes.js";
import { notify, request } from "./cell.js";
import { duration, h, notice } from "./dom.js";
import { GoalEditor } from "./goal_editor.js";

const OWN_GOAL = "";
// How long a plan may take (s).
const PLAN_LIMIT = 120;

export async function openJobDialog(cell) {
  if (document.querySelector("dialog.job")) return;
  let masters;
  if (!(await notify(request("/api/work_masters").then((answer) => (masters = answer.work_masters))))) return;
  const choice = h("select", { id: "work-master" },
    masters.map((master) => h("option", { value: master.id }, master.description || master.id.replaceAll("_", " "))),
    h("option", { value: OWN_GOAL }, "A goal…"));
  const fields = h("div", { class: "fields" });
  const problems = h("ul", { class: "problems" });
  const preview = h("div", { class: "preview" });
  const form = h("form", { method: "dialog" },
    h("h2", {}, "New job"), h("label", {}, "Job", choice), fields, preview, problems,
    h("footer", {}, h("button", { type: "button", onclick: () => dialog.close() }, "Cancel"),
      h("button", { type: "button", id: "make-plan", onclick: plan }, "Plan"),
      h("button", { type: "submit", class: "primary", id: "start-job" }, "Start")));
  const dialog = h("dialog", { class: "job", onclose: () => close() }, form);

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
    problems.replaceChildren();
  }

  function showButtons() {
    for (const id of ["make-plan", "start-job"]) form.querySelector(`#${id}`).disabled = editor !== null && !editor.isComplete;
  }

  function order() {
    if (editor) return { goal: editor.goal };
    const entries = [...fields.querySelectorAll("[name]")].filter((input) => input.value !== "").map((input) => [input.name, valueOf(input)]);
    const values = Object.fromEntries(entries);
    return { work_master: master.id, parameters: values };
  }

  async function plan() {
    preview.replaceChildren(h("p", { class: "dim" }, "Planning…"));
    problems.replaceChildren();
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

  function show(error) {
    const found = error.problems?.length ? error.problems : [{ message: error.message }];
    problems.replaceChildren(...found.map((each) => h("li", {}, each.where ? h("b", {}, `${each.where}: `) : "", each.message)));
  }

  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      await request("/api/jobs", { id: `${cell.user}-${crypto.getRandomValues(new Uint32Array(2)).join("")}`, ...order() });
      dialog.close();
      notice("The job is in the queue.", "success");
    } catch (error) {
      show(error);
    }
  });
  choice.addEventListener("change", showFields);
  showFields();
  form.addEventListener("keydown", (event) => event.key === "Escape" && dialog.close());
  document.body.append(dialog);
  dialog.show(); // not modal: the button Stop stays usable
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
    input = h("input", { type, min: parameter.minimum, max: parameter.maximum, step: type === "number" ? "any" : null });
  }
  input.name = parameter.id;
  input.dataset.type = parameter.type;
  if (parameter.default != null) input.value = parameter.default;
  return h("label", {}, parameter.unit ? `${parameter.id} (${parameter.unit})` : parameter.id, input, h("small", {}, parameter.description ?? ""));
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
  if (input.dataset.type === "number" || input.dataset.type === "integer") return Number(input.value);
  return input.dataset.type === "boolean" ? input.value === "true" : input.value;
}

// The goal of a work master with its values, as the gateway fills it.
function filled(master, values) {
  return master.goal.replace(/\{(\w+)\}/g, (_, name) => {
    const value = values[name] ?? "";
    return typeof value === "string" ? `"${value}"` : String(value);
  });
}
