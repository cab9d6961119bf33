// Stops, pauses and resumes tasks of robots, by the port that nothing else uses.

import { NoAnswer, Refusal, request } from "./cell.js";

// How long a way may take (s).
const LIMIT = 2;

// Commands all tasks of robots (none named: of all), or one task of a robot. Where the stop port cannot be reached, or does
// not know a session that has just begun, the gateway itself gets the command.
export async function commandRobots(cell, action, robots = [], task = -1, path = `/api/robots/${action}`) {
  const ways = [];
  if (cell.stopPort > 0) {
    const url = `${location.protocol}//${location.hostname}:${cell.stopPort}/api/robots/${action}`;
    ways.push(() => request(url, { robots, task }, "POST", LIMIT));
  }
  ways.push(() => request(path, task < 0 ? { robots } : {}, "POST", LIMIT));
  let problem;
  for (const way of ways) {
    try {
      return await way();
    } catch (error) {
      // An answer of the cell counts; without one the other way is tried.
      if (error instanceof Refusal && ![401, 404, 503].includes(error.status)) throw error;
      if (!(problem instanceof NoAnswer)) problem = error;
    }
  }
  const why = problem instanceof TypeError ? "The gateway cannot be reached. Use the robot's own stop if it matters." : problem.message;
  throw new Error(`${action[0].toUpperCase()}${action.slice(1)} was not confirmed: ${why}`);
}
