// A shared worker: one stream of the gateway for all tabs of the page, as a browser has only six connections to a server.

import { openSource } from "./source.js";

const KEPT = 250;
const FORGOTTEN = 180; // s: the timers of a tab in the background run once a minute
const tabs = new Map(); // when each was heard last (ms), by its port
let source = null;
let kept = []; // the last patches
let first = ""; // the event before them

const numberOf = (event) => Number(event.slice(event.lastIndexOf("-") + 1));
const streamOf = (event) => event.slice(0, event.lastIndexOf("-"));

function open(event) {
  source?.close();
  [kept, first] = [[], event];
  source = openSource(event, (kind, data, id) => {
    if (kind === "patch") {
      kept.push({ id, data });
      if (kept.length > KEPT) first = kept.shift().id;
    }
    if (kind === "reset" || kind === "refused") [source, kept] = [source.close(), []];
    for (const [port, tab] of tabs) {
      if (kind === "patch" && numberOf(id) <= tab.seen) continue; // its document has it
      if (kind === "patch") tab.seen = numberOf(id);
      port.postMessage({ kind, data });
    }
  });
}

function follow(port, event) {
  const tab = { heard: Date.now(), seen: numberOf(event) };
  tabs.set(port, tab);
  const isOther = source && streamOf(first) !== streamOf(event); // the gateway was started again
  if (!source || isOther || numberOf(event) < numberOf(first)) {
    open(event);
    for (const each of isOther ? tabs.keys() : []) if (each !== port) each.postMessage({ kind: "reset" });
    return;
  }
  for (const { id, data } of kept) {
    if (numberOf(id) <= tab.seen) continue;
    tab.seen = numberOf(id);
    port.postMessage({ kind: "patch", data });
  }
}

function leave(port) {
  tabs.delete(port);
  if (!tabs.size) source = source?.close() ?? null;
}

setInterval(() => {
  for (const [port, tab] of tabs) if (Date.now() - tab.heard > 1000 * FORGOTTEN) leave(port);
}, 10000);

/** @type {any} */ (self).onconnect = ({ ports: [port] }) => {
  port.onmessage = ({ data }) => {
    if (data.follow !== undefined) follow(port, data.follow);
    else if (data.leave) leave(port);
    else if (tabs.has(port)) tabs.get(port).heard = Date.now();
  };
};
