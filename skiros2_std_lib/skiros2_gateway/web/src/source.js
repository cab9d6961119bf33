// The stream of patches and beats of the gateway.

// A stream without beats for this time (s) is dead, though TCP may keep it for many minutes.
const DEAD = 5;

// Opens it after an event. `take(kind, data, id)` gets `patch`, `beat`, `reset`, `open`, `lost`, and `refused` when the
// browser does not try again. Returns the source, whose `close` returns null.
export function openSource(event, take) {
  const source = new EventSource(`/api/live/patches?beats=true&after=${encodeURIComponent(event)}`);
  let heard = performance.now();
  const end = () => {
    clearInterval(watch);
    source.close();
    return null;
  };
  const watch = setInterval(() => {
    if (performance.now() - heard < 1000 * DEAD) return;
    end();
    take("refused");
  }, 500);
  const listen = (kind, report) => source.addEventListener(kind, (message) => {
    heard = performance.now();
    report(message);
  });
  for (const kind of ["patch", "beat", "reset"]) listen(kind, (message) => take(kind, message.data, message.lastEventId));
  listen("open", () => take("open"));
  source.addEventListener("error", () => {
    if (source.readyState !== EventSource.CLOSED) return take("lost");
    end();
    take("refused");
  });
  return { close: end };
}
