// The page: panels, their choice, the login, and one drawing for all changes of a moment.

import { openAccount } from "./account.js";
import { AlarmsView } from "./alarms.js";
import { ApprovalsView } from "./approvals.js";
import { CamerasView } from "./cameras.js";
import { Cell, notify, request } from "./cell.js";
import { CellsView } from "./cells.js";
import { makeColumns } from "./columns.js";
import { commandRobots } from "./commands.js";
import { CellPanel } from "./cell_panel.js";
import { LogView, NodeDetails, RunBar } from "./details.js";
import { h, setText } from "./dom.js";
import { PlanView } from "./plan.js";
import { ShownRun } from "./run.js";
import { SignalsView } from "./signals.js";
import { TreeView } from "./tree.js";
import { Selection, WorldView } from "./world.js";

const PANELS = { cell: "Cell", tree: "Tree", plan: "Plan", log: "Log", signals: "Signals", scene: "3D", world: "World", cameras: "Cameras" };
const REGIONS = { centre: ["tree", "plan", "log", "signals"], right: ["scene", "world", "cameras"],
  phone: ["cell", "tree", "plan", "scene", "world", "log", "signals", "cameras"] };
const CONNECTIONS = { connecting: ["connecting", "idle"], live: ["live", "success"], lost: ["reconnecting…", "failure"],
  silent: ["", "failure"], denied: ["not logged in", "idle"] };

const main = document.getElementById("main");
/** @returns {HTMLElement} */
const panelOf = (name) => main.querySelector(`section[data-panel="${name}"]`);
const cell = new Cell();
const run = new ShownRun(cell);
const selection = new Selection(cell);
const alarms = new AlarmsView(cell);
const approvals = new ApprovalsView(cell);
const cells = new CellsView(cell);
const signals = new SignalsView(panelOf("signals"), cell, run, selection);
const cameras = new CamerasView(panelOf("cameras"), cell, showCameras);
/** @type {[HTMLElement, any][]} */
const views = [
  [alarms.button, alarms],
  [approvals.button, approvals],
  [panelOf("cell"), new CellPanel(panelOf("cell"), cell, run, selection)],
  [document.getElementById("run-bar"), new RunBar(document.getElementById("run-bar"), cell, run)],
  [panelOf("tree"), new TreeView(panelOf("tree"), cell, run)],
  [panelOf("tree"), new NodeDetails(panelOf("tree"), cell, run)],
  [panelOf("plan"), new PlanView(panelOf("plan"), cell, run)],
  [panelOf("log"), new LogView(panelOf("log"), cell, run)],
  [panelOf("signals"), signals],
  [panelOf("world"), new WorldView(panelOf("world"), cell, run, selection)],
  [panelOf("cameras"), cameras],
];

// -- drawing: views whose tables have changed, at most once per picture, and only those in sight ------------------------

const stale = new Set();
let isDrawing = false;

/** @param {(view: any) => boolean} which */
function draw(which = () => true) {
  for (const entry of views) if (which(entry[1])) stale.add(entry);
  if (isDrawing) return;
  isDrawing = true;
  requestAnimationFrame(() => {
    isDrawing = false;
    if (!cell.document) return;
    for (const entry of stale) {
      if (entry[0].offsetParent === null && !entry[0].hidden) continue; // another panel is shown
      stale.delete(entry);
      entry[1].render();
    }
  });
}

let scene = null;
let isLoading = false;

// The 3D view is a file of its own, read when the page is shown.
async function showScene() {
  if (isLoading || panelOf("scene").offsetParent === null || !cell.document) return;
  isLoading = true;
  const note = h("p", { class: "empty" }, "Loading the 3D view…");
  panelOf("scene").append(note);
  try {
    const { Scene } = await import("./scene.js");
    scene = new Scene(panelOf("scene"), cell, run, selection);
    scene.take(null);
    scene.fit();
    panelOf("scene").append(h("button", { class: "small fit", onclick: () => scene.fit() }, "Show all"));
  } catch (error) {
    panelOf("scene").append(h("p", { class: "empty" }, `No 3D view: ${error.message}`));
  } finally {
    note.remove();
  }
}

cell.addEventListener("change", (/** @type {CustomEvent} */ { detail: patch }) => {
  signals.take(patch ? (patch.signals ?? {}) : null);
  if (!patch || patch.runs) run.refresh();
  scene?.take(patch);
  if (!patch || patch.elements) cameras.take();
  draw((view) => !patch || view.tables.some((table) => table in patch));
  if (!patch) setTimeout(showScene);
});
run.addEventListener("change", () => {
  scene?.takeRun();
  draw();
});
selection.addEventListener("change", () => {
  draw((view) => view.tables.some((table) => ["elements", "signals", "cell"].includes(table)));
  scene?.draw();
});

// Times of running nodes and steps go on without a change of the document.
setInterval(() => {
  const isRunning = !run.hasEnded && run.time === null;
  if (isRunning || views.some(([, view]) => view.isMoving))
    draw((view) => view.isMoving || (isRunning && view.tables.some((table) => table === "trees" || table === "runs")));
}, 250);

// -- the header and the choice of panels ------------------------------------------------------------------------------

const connection = h("span", { class: "chip", id: "connection" });
const user = h("button", { class: "small", id: "user", onclick: () => openAccount(cell), title: "The user, with the role; opens sessions and the logout" });
const stop = h("button", { class: "small stop", id: "stop-all", onclick: () => notify(commandRobots(cell, "stop")) }, "Stop all tasks");
const theme = h("button", { class: "small", title: "Dark or light", "aria-label": "Dark or light", onclick: () => setTheme(isDark() ? "light" : "dark") }, "◐");
document.getElementById("header").append(h("h1", {}, "SkiROS2"), connection, h("span", { class: "grow" }), cells.button, alarms.button, approvals.button, stop, user, theme);

function showConnection() {
  const [word, role] = CONNECTIONS[cell.connection];
  connection.className = `chip ${role} ${cell.connection}`;
  setText(connection, word || `no data for ${Math.floor(cell.silence)} s, reconnecting…`);
  document.body.classList.toggle("stale", cell.connection === "lost" || cell.connection === "silent");
  setText(user, cell.user === cell.role ? cell.user : `${cell.user} (${cell.role})`);
  user.hidden = !cell.user;
  stop.hidden = !cell.mayCommand;
}
cell.addEventListener("connection", showConnection);

function isDark() {
  const chosen = document.documentElement.style.colorScheme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

function setTheme(name) {
  document.documentElement.style.colorScheme = name;
  localStorage.theme = name;
  scene?.theme();
  draw();
}
if (localStorage.theme) setTheme(localStorage.theme);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => scene?.theme());

function choose(region, name) {
  main.dataset[region] = name;
  for (const tab of document.querySelectorAll(`nav[data-region="${region}"] button`))
    tab.setAttribute("aria-current", String(tab.getAttribute("data-tab") === name));
  draw();
  showScene();
  scene?.draw();
}

for (const [region, names] of Object.entries(REGIONS)) {
  const nav = document.querySelector(`nav[data-region="${region}"]`);
  nav.append(...names.map((name) => h("button", { "data-tab": name, onclick: () => choose(region, name) }, PANELS[name])));
  choose(region, names[0]);
}
// The tabs of the cameras, where there are any.
function showCameras(isShown) {
  for (const tab of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("nav [data-tab=cameras]"))) tab.hidden = !isShown;
  if (isShown) return;
  if (main.dataset.right === "cameras") choose("right", "scene");
  if (main.dataset.phone === "cameras") choose("phone", "cell");
}

// A panel asks for another one, such as the list of runs for the tree.
main.addEventListener("show-panel", (/** @type {CustomEvent} */ { detail: name }) => {
  choose("phone", name);
  choose("centre", name);
});

makeColumns(main);

// -- the login --------------------------------------------------------------------------------------------------------

cell.addEventListener("denied", () => {
  if (document.querySelector("dialog.login")) return;
  const name = h("input", { name: "user", id: "name", autocomplete: "username" });
  const token = h("input", { type: "password", name: "token", id: "token", autocomplete: "current-password", required: true });
  const problem = h("p", { class: "problems" });
  const form = h("form", { method: "dialog" }, h("h2", {}, "Log in"),
    h("label", {}, "User", name, h("small", {}, "With a token it may be empty.")),
    h("label", {}, "Password or token", token, h("small", {}, "The gateway's file users.yaml has a token for each user.")), problem,
    h("footer", {}, h("button", { class: "primary", id: "login" }, "Log in")));
  const dialog = h("dialog", { class: "login", oncancel: (event) => event.preventDefault() }, form);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      const user = name.value.trim();
      await request("/api/session", user ? { user, password: token.value } : { token: token.value });
      dialog.remove();
      cell.connect();
    } catch (error) {
      setText(problem, error.message);
    }
  });
  document.body.append(dialog);
  dialog.showModal();
});

showConnection();
cell.connect();
