// The dialog of the user: name, role, open sessions of the page with a way to end each, and the logout.

import { notify, request } from "./cell.js";
import { openDialog } from "./dialogs.js";
import { h, moment } from "./dom.js";

const OPERATE = "reads, commands jobs and robots";
const ROLES = { view: "reads", operate: OPERATE, approve: `${OPERATE}, answers what agents ask for`,
  maintain: `${OPERATE}, answers what agents ask for, reads the audit log, ends sessions of others` };

export async function openAccount(cell) {
  const list = h("ul", { class: "sessions" });
  const logout = async () => {
    await notify(request("/api/session", undefined, "DELETE"));
    location.reload();
  };
  openDialog("account", "Account", h("h2", {}, cell.user),
    h("p", {}, `Role ${cell.role}: ${ROLES[cell.role] ?? ""}.`), h("h3", {}, "Sessions"), list,
    h("div", {}, h("button", { type: "button", id: "logout", onclick: logout }, "Log out")));
  await notify(request("/api/sessions").then(({ sessions }) => list.append(...sessions.map((session) => row(cell, session, logout)))));
}

function row(cell, { id, user, address, created, ends, is_own }, logout) {
  const end = async () => {
    if (is_own) await logout();
    else if (await notify(request(`/api/sessions/${id}`, undefined, "DELETE"))) element.remove();
  };
  const element = h("li", {}, h("span", {}, `${user} at ${address}${is_own ? " (this one)" : ""}`),
    h("span", { class: "dim" }, `since ${moment(created, cell.now)}, ends ${moment(ends, cell.now)}`),
    h("button", { type: "button", class: "small", onclick: end, "aria-label": `End the session of ${user}, ${moment(created, cell.now)}` }, "End"));
  return element;
}
