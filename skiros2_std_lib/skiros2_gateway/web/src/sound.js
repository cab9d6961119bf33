// The sound of alarms: two tones when an alarm comes, and again while it waits to be acknowledged. It can be switched off, which
// the browser remembers.

import { h } from "./dom.js";

// How often it sounds (s), and its tones (Hz) and their length (s).
const PERIOD = 20;
const TONES = [880, 660];
const LENGTH = 0.18;

export class AlarmSound {
  #context = null;
  #known = new Set();

  constructor() {
    this.input = h("input", { type: "checkbox", id: "alarm-sound", checked: localStorage.alarmSound !== "off",
      onchange: () => (localStorage.alarmSound = this.input.checked ? "on" : "off") });
    this.switch = h("label", { class: "check" }, this.input, "Sound");
    setInterval(() => this.#known.size && this.#play(), 1000 * PERIOD);
  }

  // Sounds if there are other alarms than before; `unseen` are the ids of those that wait.
  follow(unseen) {
    const isMore = unseen.some((id) => !this.#known.has(id));
    this.#known = new Set(unseen);
    if (isMore) this.#play();
  }

  // A browser has no sound before the first click of a page: it is left out then.
  #play() {
    if (!this.input.checked || navigator.userActivation?.hasBeenActive === false) return;
    this.#context ??= new AudioContext();
    const gain = this.#context.createGain();
    gain.gain.value = 0.15;
    gain.connect(this.#context.destination);
    TONES.forEach((frequency, number) => {
      const tone = this.#context.createOscillator();
      const begin = this.#context.currentTime + number * LENGTH;
      tone.frequency.value = frequency;
      tone.connect(gain);
      tone.start(begin);
      tone.stop(begin + LENGTH);
    });
  }
}
