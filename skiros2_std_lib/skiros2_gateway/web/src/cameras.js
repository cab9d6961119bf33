// The newest pictures of the cell's cameras. They are read one after the other, only while they are in sight.

import { Refusal, readPicture } from "./cell.js";
import { duration, h, keyed, setText } from "./dom.js";

const TOPICS = ["skiros:RgbTopic", "skiros:DepthTopic", "skiros:DepthImageRaw"];
const PERIOD = 200; // ms, between two requests
const PAUSE = 1000; // ms, after one without a picture
const OLD = 2; // s

export class CamerasView {
  tables = ["elements"];
  isMoving = true; // the ages of pictures
  #shown = ""; // the camera that is shown alone; "": all
  #isReading = false;

  constructor(panel, cell, show) {
    this.cell = cell;
    this.show = show;
    this.list = h("div", { class: "cameras" });
    panel.append(this.list);
    document.addEventListener("visibilitychange", () => void this.#read());
  }

  get #ids() {
    const { elements } = this.cell.document;
    return Object.keys(elements).filter((id) => TOPICS.some((topic) => elements[id].properties[topic]?.some(Boolean))).sort();
  }

  // After each change of the elements, also while the panel is hidden.
  take() {
    this.show(this.#ids.length > 0);
  }

  render() {
    const ids = this.#ids;
    if (!ids.includes(this.#shown)) this.#shown = "";
    this.list.classList.toggle("one", Boolean(this.#shown));
    keyed(this.list, ids, (id) => id, (id) => this.#make(id), (item, id) => {
      item.hidden = Boolean(this.#shown) && this.#shown !== id;
      const name = this.cell.name(id);
      setText(item.name, name);
      item.image.alt = `Picture of ${name}`;
      item.button.setAttribute("aria-pressed", String(this.#shown === id));
      const age = item.age === null ? null : item.age + (performance.now() - item.at) / 1000;
      const isOld = Boolean(item.problem) || age === null || age > OLD;
      item.button.hidden = age === null;
      item.classList.toggle("old", isOld && (age !== null || Boolean(item.problem)));
      setText(item.note, item.problem || (age === null ? "no picture yet" : isOld ? `picture of ${duration(age)} ago` : "live"));
    });
    void this.#read();
  }

  #make(id) {
    const item = h("figure", { class: "camera" });
    item.age = null;
    item.at = 0;
    item.tag = item.problem = "";
    item.image = h("img", { alt: "" });
    item.button = h("button", { title: "Show this camera alone, or all", onclick: () => {
      this.#shown = this.#shown ? "" : id;
      this.render();
    } }, item.image);
    item.append(item.button, h("figcaption", {}, (item.name = h("b")), (item.note = h("span", { class: "dim" }))));
    return item;
  }

  get #isInSight() {
    return this.list.offsetParent !== null && !document.hidden && this.cell.connection === "live";
  }

  async #read() {
    if (this.#isReading) return;
    this.#isReading = true;
    while (this.#isInSight && this.list.known?.size) {
      for (const [id, item] of [...this.list.known]) {
        if (item.hidden || !this.#isInSight) continue;
        const isNew = await this.#readOne(id, item);
        await new Promise((done) => setTimeout(done, isNew ? PERIOD : PAUSE));
      }
    }
    this.#isReading = false;
  }

  // Returns whether there is a picture.
  async #readOne(id, item) {
    try {
      const { headers, status, blob } = await readPicture(`/api/live/cameras/${encodeURIComponent(id)}/picture`, item.tag);
      item.age = Number(headers.get("X-Age"));
      item.at = performance.now();
      item.tag = headers.get("ETag");
      item.problem = "";
      if (status === 304) return true;
      const before = item.image.src;
      item.image.src = URL.createObjectURL(blob);
      if (before) URL.revokeObjectURL(before);
      return true;
    } catch (error) {
      item.problem = error instanceof Refusal ? error.message : "no answer";
      return false;
    } finally {
      if (!item.isConnected) URL.revokeObjectURL(item.image.src);
    }
  }
}
