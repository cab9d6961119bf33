// What agents ask for: a button in the header while requests wait, and the dialog in which a person answers them.

import { notify, request } from "./cell.js";
import { show } from "./dialogs.js";
import { duration, h, keyed, setText } from "./dom.js";

export class ApprovalsView {
  tables = ["approvals", "elements"];
  isMoving = false; // the time that is left is shown

  constructor(cell) {
    this.cell = cell;
    this.button = h("button", { class: "small asks", id: "approvals", hidden: true, onclick: () => show(this.dialog) });
    this.list = h("div", { class: "list" });
    this.note = h("p", { class: "dim" });
    this.dialog = h("dialog", { class: "approvals", "aria-label": "Waiting approvals" }, h("form", { method: "dialog" },
      h("h2", {}, "Agents ask for"), this.note, this.list,
      h("div", { class: "end" }, h("button", { id: "close-approvals" }, "Close"))));
    document.body.append(this.dialog);
  }

  render() {
    const waiting = Object.values(this.cell.document.approvals).sort((a, b) => a.created - b.created);
    this.button.hidden = waiting.length === 0;
    this.isMoving = waiting.length > 0;
    setText(this.button, waiting.length === 1 ? "1 approval waits" : `${waiting.length} approvals wait`);
    setText(this.note, waiting.length === 0 ? "Nothing waits for an approval." : this.cell.mayApprove ? ""
      : "You may read this. A person with the role approve answers.");
    this.note.hidden = !this.note.textContent;
    keyed(this.list, waiting, ({ id }) => id, (approval) => this.#make(approval), (element, approval) => {
      setText(element.left, `${duration(Math.max(0, approval.expires - this.cell.now)).replace(/\.\d+/, "")} left`);
      element.answers.hidden = !this.cell.mayApprove;
    });
  }

  #make(approval) {
    const { what } = approval;
    const parameters = what.values ?? what.parameters;
    const names = (text) => this.cell.withNames(text);
    const answer = (word) => async () => {
      for (const each of element.answers.children) each.disabled = true;
      const body = { digest: approval.digest, reason: reason.value };
      if (!(await notify(request(`/api/approvals/${approval.id}/${word}`, body))))
        for (const each of element.answers.children) each.disabled = false;
    };
    const element = h("section", { class: "approval" });
    const reason = h("input", { maxlength: 1000, placeholder: "Reason, for the agent", "aria-label": "Reason of the answer", "data-field": "reason" });
    element.left = h("span", { class: "dim" });
    element.answers = h("div", { class: "buttons" }, reason,
      h("button", { type: "button", class: "small", "data-action": "reject", onclick: answer("reject") }, "Reject"),
      h("button", { type: "button", class: "small primary", "data-action": "approve", onclick: answer("approve") }, "Approve"));
    const fact = (name, value) => value && h("div", {}, h("dt", {}, name), h("dd", {}, value));
    const list = (title, tag, items) => items?.length > 0 && [h("h3", {}, title), h(tag, {}, items.map((item) => h("li", {}, item)))];
    const values = (data) => Object.entries(data).map(([key, value]) => `${key} ${this.cell.name(String(value))}`).join(", ");
    element.append(
      // a label may be misleading: the ids are in the tooltip
      h("header", {}, h("b", { title: what.goal ?? what.skill }, title(approval, names)), element.left),
      h("dl", { class: "facts" },
        fact("Agent", approval.user),
        fact("Robots", approval.robots.map((robot) => robot.slice(1)).join(", ")),
        fact("Reason", approval.reason),
        fact("Job", what.order?.id),
        fact("Starts again", what.retry && (what.retry.id ?? what.retry.skill)),
        fact("Parameters", parameters && h("span", { title: JSON.stringify(parameters) }, values(parameters))),
        fact("Digest", approval.digest.slice(0, 16))),
      what.plan?.length === 0 ? h("p", {}, "Nothing to do: the goal holds already.") : "",
      ...[list("Plan", "ol", what.plan?.map((step) => [h("b", { title: JSON.stringify(step.arguments) }, step.label), " ",
        Object.values(step.arguments).map((id) => this.cell.name(id)).join(", "), h("span", { class: "dim" }, ` ${step.robot.slice(1)}`)])),
      list("Expected changes", "ul", what.changes?.map((line) => h("span", { title: line }, names(line))))].flat().filter(Boolean),
      element.answers);
    return element;
  }
}

// What is asked for; `names` puts the names of elements for their ids.
export function title({ what, title: sentence }, names) {
  if (what.goal) return names(sentence);
  if (what.skill) return what.implementation ?? what.skill;
  return "Changes of the world model";
}
