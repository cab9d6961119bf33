"""Measures the platform beside its peers, prints a table, and writes it as JSON: `make bench`."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from benchmarks.compare import compare  # noqa: E402 - after the path
from benchmarks.history import clean_commit, keep  # noqa: E402 - after the path
from benchmarks.measurement import Measurement, table  # noqa: E402 - after the path
from support.ros import Ros, RosMaster  # noqa: E402

#: What the function `measure` of each part's module takes.
NOTHING, FOLDER, NODE = "nothing", "a folder", "a master and a folder"
PARTS = {
    "launch": FOLDER, "ticks": NOTHING, "inference": NOTHING, "skills": NODE, "services": NODE, "updates": NODE,
    "tf": NODE, "planning": FOLDER, "schedules": NOTHING, "replanning": NOTHING, "world_model": FOLDER,
    "journal": FOLDER, "weeks": FOLDER, "size": FOLDER, "fleet": NOTHING, "fleet_nodes": NODE, "simulation": NODE,
    "contact": NODE, "use_case": FOLDER, "bags": FOLDER, "window": NODE,
    "size_million": FOLDER, "weeks_month": FOLDER,
}  # fmt: skip
#: Parts that are measured only when they are named: too long, or too large for some machines.
ONLY_NAMED = ("size_million", "weeks_month")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, default=ROOT / "build/bench.json", help="where the figures go")
    known = ", ".join(PARTS)
    default = [part for part in PARTS if part not in ONLY_NAMED]
    parser.add_argument("--compare", metavar="REV", default="", help="measure another commit too, and compare")
    parser.add_argument("--keep", action="store_true", help="write the figures to docs/bench.md too")
    parser.add_argument(
        "parts",
        nargs="*",
        metavar="PART",
        default=default,
        help=f"of {known}; default: all but {', '.join(ONLY_NAMED)}",
    )
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # ends the nodes that were started
    unknown = set(arguments.parts) - set(PARTS)
    if unknown:
        parser.error(f"no part {', '.join(sorted(unknown))}; there are: {known}")
    if arguments.compare:
        return compare(ROOT, arguments.compare, arguments.parts)
    load, _, _ = os.getloadavg()
    try:
        commit = clean_commit(ROOT) if arguments.keep else ""
    except ValueError as error:
        parser.error(str(error))

    done: list[Measurement] = []
    failed: list[str] = []
    with tempfile.TemporaryDirectory(prefix="skiros2-bench-") as folder, ExitStack() as stack:
        node = _Node(Path(folder), stack)
        for part in arguments.parts:
            print(f"measuring {part} ...", file=sys.stderr, flush=True)
            start = time.monotonic()
            try:
                for measurement in _measure(part, Path(folder), node):
                    print(f"    {measurement.name}: ratio {measurement.ratio:.2f}", file=sys.stderr, flush=True)
                    done.append(measurement)
            except Exception:  # the other parts are measured all the same
                traceback.print_exc()
                failed.append(part)
            print(f"    {part}: {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)
    print(table(done))
    if failed:
        print(f"not measured to the end: {', '.join(failed)}", file=sys.stderr)
    arguments.json.parent.mkdir(parents=True, exist_ok=True)
    arguments.json.write_text(json.dumps([m.as_json() for m in done], indent=2) + "\n")
    if commit:
        keep(ROOT / "tests/benchmarks/history.json", ROOT / "docs", commit, load, done)
    return 1 if failed else 0


def _measure(part: str, folder: Path, node: _Node) -> Iterator[Measurement]:
    module = importlib.import_module(f"benchmarks.{part}")
    if PARTS[part] == NODE:
        return node.measure(module.measure)
    return module.measure(folder) if PARTS[part] == FOLDER else module.measure()  # type: ignore[no-any-return]


class _Node:
    """A master and a node in this process, for the parts that measure nodes; started for the first of them."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder = folder
        self._stack = stack
        self._master: RosMaster | None = None

    def measure(self, part: Callable[[Ros, Path], Iterator[Measurement]]) -> Iterator[Measurement]:
        import rospy

        if self._master is None:
            self._master = self._stack.enter_context(RosMaster(self._folder))
            os.environ.update(self._master.env)
            rospy.init_node("bench", anonymous=True, disable_signals=True)
            self._stack.callback(rospy.signal_shutdown, "measured")
        ros = Ros(self._master)
        try:
            yield from part(ros, self._folder)
        finally:
            ros.stop()


if __name__ == "__main__":
    sys.exit(main())
