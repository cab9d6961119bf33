// The connection to the gateway: the document of the live view, followed by patches, and requests.

import { localName, notice } from "./dom.js";
import { applyPatch } from "./patch.js";

// An answer with problem details (RFC 9457).
export class Refusal extends Error {
  constructor(problem) {
    super(problem.detail ?? problem.title);
    this.status = problem.status;
    this.problems = problem.problems ?? [];
  }
}

// Sends a request; with a body or a method it is a command.
export async function request(path, body, method = body === undefined ? "GET" : "POST") {
  const headers = method === "GET" ? {} : { "X-Gateway": "1", "Content-Type": "application/json" };
  const response = await fetch(path, { method, headers, body: body === undefined ? undefined : JSON.stringify(body) });
  const answer = await response.json();
  if (!response.ok) throw new Refusal({ status: response.status, ...answer });
  return answer;
}

// The document. Dispatches `change` (detail: the patch, or null for a new document), `connection` and `denied`.
export class Cell extends EventTarget {
  document = null;
  connection = "connecting";
  role = "";
  user = "";
  person = false;
  styles = {};
  #source = null;
  #retry = 0;
  #offset = 0;

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
    return text.replace(/[\w.]+:[\w.]+-\d+/g, (id) => (elements?.[id] ? this.label(id, elements) : id));
  }

  async connect() {
    clearTimeout(this.#retry);
    this.#source?.close();
    this.#source = null;
    let answer;
    try {
      answer = await request("/api/live");
    } catch (error) {
      if (error instanceof Refusal && (error.status === 401 || error.status === 403)) {
        this.#setConnection("denied");
        this.dispatchEvent(new CustomEvent("denied", { detail: error }));
      } else {
        this.#setConnection("lost");
        this.#retry = setTimeout(() => this.connect(), 500);
      }
      return;
    }
    ({ document: this.document, role: this.role, user: this.user, person: this.person, styles: this.styles } = answer);
    this.#offset = answer.time - Date.now() / 1000;
    this.#setConnection("live");
    this.#changed(null);
    this.#follow(answer.event);
  }

  #follow(event) {
    const source = (this.#source = new EventSource(`/api/live/patches?after=${encodeURIComponent(event)}`));
    source.addEventListener("patch", (message) => {
      const { data, time } = JSON.parse(message.data);
      // The event that took the shortest way tells most about the difference of the clocks.
      this.#offset = Math.max(this.#offset, time - Date.now() / 1000);
      applyPatch(this.document, data);
      this.#changed(data);
    });
    source.addEventListener("reset", () => this.connect());
    source.addEventListener("open", () => this.#setConnection("live"));
    source.addEventListener("error", () => {
      this.#setConnection("lost");
      // A refused stream is closed by the browser, a lost one is opened again by it.
      if (source.readyState === EventSource.CLOSED) this.#retry = setTimeout(() => this.connect(), 500);
    });
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
