// The names and states of jobs for people.

const ROLES = { Running: "running", Interrupted: "paused", Ended: "success", Aborted: "failure" };
const WORDS = { NotAllowedToStart: "stored", AllowedToStart: "queued", Running: "running", Interrupted: "interrupted" };
const EVENTS = { Store: "stored", StoreAndStart: "ordered", Start: "may start", RevokeStart: "may not start yet", Update: "changed",
  loaded: "is next", accepted: "started", collected: "results collected", ReceiveJobResponse: "response received" };
const REACHED = new Set(["", "succeeded", "nothing_to_do"]);

export const hasFailed = ({ state, response }) => response.outcome !== "cancelled" && (state === "Aborted" || !REACHED.has(response.outcome));

// What has happened to a job, of its history.
export const eventWord = (method) => EVENTS[method] ?? method.toLowerCase();

export function jobTitle(cell, { id, order, goal }) {
  if (order.description) return order.description;
  const values = Object.values(order.parameters).map((value) => cell.label(value)).join(", ");
  return order.work_master ? `${order.work_master.replaceAll("_", " ")}: ${values}` : goalTitle(cell, id, goal);
}

// The goal of a job as a sentence; of a job that the page does not have, as text.
export const goalTitle = (cell, id, goal) => cell.document.goals[id]?.title ?? cell.withLabels(cell.document.jobs[id]?.title ?? goal);

export const jobRole = (job) => (hasFailed(job) ? "failure" : job.response.outcome === "cancelled" ? "idle" : (ROLES[job.state] ?? "idle"));

export function jobWord(job) {
  const { state, response } = job;
  if (WORDS[state]) return WORDS[state];
  return state === "Ended" && REACHED.has(response.outcome) ? "succeeded" : (response.outcome || "failed").replaceAll("_", " ");
}
