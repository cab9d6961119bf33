// The widths of the columns: dragged, or changed by the arrow keys; a double click resets one. The browser remembers them.

const STEP = 24; // px
const LEAST = 220; // px

export function makeColumns(main) {
  for (const bar of main.querySelectorAll('[role="separator"]')) {
    const name = bar.dataset.column;
    const property = `--${name}`;
    const set = (width) => {
      const most = main.clientWidth - 2 * LEAST;
      const shown = Math.round(Math.min(most, Math.max(LEAST, width)));
      main.style.setProperty(property, `${shown}px`);
      bar.setAttribute("aria-valuenow", shown);
      localStorage[`column-${name}`] = shown;
    };
    const width = () => bar.previousElementSibling.clientWidth;
    bar.setAttribute("aria-valuenow", Math.round(width()));
    if (localStorage[`column-${name}`]) set(Number(localStorage[`column-${name}`]));
    bar.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -STEP, ArrowRight: STEP }[event.key];
      if (step) set(width() + step);
    });
    bar.addEventListener("pointerdown", (event) => {
      const [start, from] = [width(), event.clientX];
      bar.setPointerCapture(event.pointerId);
      bar.onpointermove = (move) => set(start + move.clientX - from);
    });
    for (const end of ["pointerup", "pointercancel"]) bar.addEventListener(end, () => (bar.onpointermove = null));
    bar.addEventListener("dblclick", () => {
      main.style.removeProperty(property);
      delete localStorage[`column-${name}`];
    });
  }
}
