// Why there is no plan, and why a run or a job has failed: a sentence, and the details under it.

import { firstLine } from "./dom.js";

// Of an answer to /api/plan without steps.
export function causeOfNoPlan({ message }) {
  const sentence = firstLine(message);
  return { sentence, details: message.slice(sentence.length + 1) };
}

// Of an answer to /api/live/runs/KEY/why; "" if the manager knows no cause.
export const causeOfRun = ({ text, explanations }) => (explanations.length ? firstLine(text) : "");

// Of the response of a job; `withLabels` puts the names of elements for their ids.
export function causeOfJob({ message }, withLabels) {
  const details = withLabels(message);
  return { sentence: firstLine(details), details };
}
