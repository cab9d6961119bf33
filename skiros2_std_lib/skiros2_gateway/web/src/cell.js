// The connection to the gateway: the document of the live view, followed by patches, and requests.

import { localName, notice } from "./dom.js";
import { applyPatch, withoutPrototypes } from "./patch.js";
import { Stream } from "./stream_client.js";

// An answer with problem details (RFC 9457).
export class Refusal extends Error {
  constructor(problem) {
    super(problem.detail ?? problem.title);
    this.status = problem.status;
    this.problems = problem.problems ?? [];
  }
}

// The gateway has not answered in time.
export class NoAnswer extends Error {
  constructor(limit) {
    super(`The gateway has not answered within ${limit} s. Use the robot's own stop if it matters.`);
  }
}

// How long an answer may take (s): of a command, and of what is read.
const COMMAND_LIMIT = 10;
const READ_LIMIT = 30;

// For the deadlines of commands: how far the clock of the gateway's machine is ahead of this page's, at least (s).
let clockOffset = -Infinity;

function deadline(limit) {
  if (clockOffset === -Infinity) return {};
  return { "X-Deadline": (performance.now() / 1000 + clockOffset + limit).toFixed(3) };
}

// Sends a request; with a body or a method it is a command, which is carried out within its time limit (s) or never.
// An address of another port is that of stops.
export async function request(path, body, method = body === undefined ? "GET" : "POST", limit = method === "GET" ? READ_LIMIT : COMMAND_LIMIT) {
  const headers = method === "GET" ? {} : { "X-Gateway": "1", "Content-Type": "application/json", ...deadline(limit) };
  const signal = AbortSignal.timeout(1000 * limit);
  let response, answer;
  try {
    response = await fetch(path, { method, headers, signal, credentials: "include", body: body === undefined ? undefined : JSON.stringify(body) });
    answer = await response.json();
  } catch (error) {
    throw error.name === "TimeoutError" ? new NoAnswer(limit) : error;
  }
  if (!response.ok) throw new Refusal({ status: response.status, ...answer });
  return answer;
}

// Reads a picture: {status, headers, blob}; status 304: it is still that with the tag.
export async function readPicture(path, tag) {
  const headers = tag ? { "If-None-Match": tag } : {};
  const answer = await fetch(path, { headers, signal: AbortSignal.timeout(1000 * READ_LIMIT), credentials: "include" });
  if (!answer.ok && answer.status !== 304) throw new Refusal({ status: answer.status, ...(await answer.json()) });
  return { status: answer.status, headers: answer.headers, blob: await answer.blob() };
}

// Ids of elements in a text.
const ID = /[\w.]+:[\w.]+-\d+/g;
// Prefixes of other names, such as those of relations.
const PREFIX = /(?<![\w./:-])[A-Za-z]\w*:(?=[A-Za-z]\w*\b(?!-\d))/g;

// A viewer without data for this time (s) is not connected, whatever the browser says: beats come once a second.
const SILENCE = 3;

// The document. Dispatches `change` (detail: the patch, or null for a new document), `connection` and `denied`.
export class Cell extends EventTarget {
  document = null;
  connection = "connecting";
  role = "";
  user = "";
  person = false;
  styles = {};
  stopPort = -1;
  #stream = new Stream((kind, data) => this.#take(kind, data));
  #retry = 0;
  #offset = 0;
  #heard = performance.now();

  constructor() {
    super();
    setInterval(() => this.#checkSilence(), 250);
  }

  // How long nothing has come from the gateway (s).
  get silence() {
    return (performance.now() - this.#heard) / 1000;
  }

  // The gateway's time (s since the epoch).
  get now() {
    return Date.now() / 1000 + this.#offset;
  }

  get mayCommand() {
    return ["operate", "approve", "maintain"].includes(this.role);
  }

  // Whether the user may answer what agents ask for. The gateway checks it.
  get mayApprove() {
    return this.person && (this.role === "approve" || this.role === "maintain");
  }

  // The name of an element for people: its label, or its id.
  label(id, elements = this.document?.elements) {
    return localName(elements?.[id]?.label || String(id));
  }

  // A text for people: with the names of the elements in it.
  withLabels(text, elements = this.document?.elements) {
    return text.replace(PREFIX, "").replace(ID, (id) => (elements?.[id] ? this.label(id, elements) : id));
  }

  // The name of an element for a decision: with the id if others have the same label.
  name(id) {
    const elements = this.document.elements;
    const label = this.label(id);
    const isSame = ([other, { type }]) => other !== id && type !== "skiros:Parameter" && this.label(other) === label;
    return elements[id] && Object.entries(elements).some(isSame) ? `${label} (${localName(id)})` : label;
  }

  // A text for a decision, with such names.
  withNames(text) {
    return text.replace(PREFIX, "").replace(ID, (id) => (this.document.elements[id] ? this.name(id) : id));
  }

  async connect() {
    clearTimeout(this.#retry);
    this.#stream.leave();
    let answer;
    try {
      answer = await request("/api/live", undefined, "GET", SILENCE);
    } catch (error) {
      if (error instanceof Refusal && (error.status === 401 || error.status === 403)) {
        this.#setConnection("denied");
        this.dispatchEvent(new CustomEvent("denied", { detail: error }));
      } else {
        if (this.connection !== "silent") this.#setConnection("lost");
        this.#retry = setTimeout(() => this.connect(), 500);
      }
      return;
    }
    ({ document: this.document, role: this.role, user: this.user, person: this.person, styles: this.styles, stop_port: this.stopPort } = answer);
    withoutPrototypes(this.document);
    clockOffset = -Infinity; // another gateway has another clock
    this.#hear(answer.clock);
    this.#offset = answer.time - Date.now() / 1000;
    this.#setConnection("live");
    this.#changed(null);
    this.#follow(answer.event);
  }

  #follow(event) {
    this.#stream.follow(event);
  }

  // What comes from the stream: `patch`, `beat`, `reset`, `open`, `lost` or `refused`.
  #take(kind, data) {
    if (kind === "lost" || kind === "refused") {
      if (this.connection !== "silent") this.#setConnection("lost");
      clearTimeout(this.#retry);
      if (kind === "refused") this.#retry = setTimeout(() => this.connect(), 500);
      return;
    }
    this.#hear(kind === "beat" ? Number(data) : null);
    if (this.connection === "lost" || this.connection === "silent") this.#setConnection("live");
    if (kind === "reset") this.connect();
    if (kind !== "patch") return;
    const { data: patch, time } = JSON.parse(data);
    // The event that took the shortest way tells most about the difference of the clocks.
    this.#offset = Math.max(this.#offset, time - Date.now() / 1000);
    applyPatch(this.document, patch);
    this.#changed(patch);
  }

  #hear(clock) {
    this.#heard = performance.now();
    // The time that took the shortest way is the most exact one.
    if (clock !== null) clockOffset = Math.max(clockOffset, clock - this.#heard / 1000);
  }

  #checkSilence() {
    if (!this.document || this.silence < SILENCE || this.connection === "denied") return;
    if (this.connection === "silent") this.dispatchEvent(new CustomEvent("connection")); // it counts
    else this.#setConnection("silent");
  }

  #changed(patch) {
    this.dispatchEvent(new CustomEvent("change", { detail: patch }));
  }

  #setConnection(state) {
    if (this.connection === state) return;
    this.connection = state;
    this.dispatchEvent(new CustomEvent("connection"));
  }
}

// Shows the error of a command; returns whether it was carried out.
export async function notify(command) {
  try {
    await command;
    return true;
  } catch (error) {
    notice(error.message);
    return false;
  }
}
