// A tab's part of the stream that all tabs share; a browser without shared workers has one stream for each tab.

import { openSource } from "./source.js";

export class Stream {
  #port = null;
  #source = null;
  #take;

  // `take(kind, data)`: see `openSource`.
  constructor(take) {
    this.#take = take;
    if (typeof SharedWorker === "undefined") return;
    this.#port = new SharedWorker("/page/stream.js", { type: "module", name: "skiros2" }).port;
    this.#port.onmessage = ({ data: { kind, data } }) => this.#take(kind, data);
    setInterval(() => this.#port.postMessage({ here: true }), 20000);
    addEventListener("pagehide", () => this.leave());
  }

  follow(event) {
    if (this.#port) this.#port.postMessage({ follow: event });
    else this.#source = openSource(event, this.#take);
  }

  leave() {
    this.#port?.postMessage({ leave: true });
    this.#source = this.#source?.close() ?? null;
  }
}
