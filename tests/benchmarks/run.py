"""Measures the platform beside its peers, prints a table, and writes it as JSON: `make bench`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from benchmarks.measurement import Measurement, table  # noqa: E402 - after the path
from support.ros import Ros, RosMaster  # noqa: E402

PARTS = ("launch", "ticks", "inference", "skills", "services", "updates", "tf")
PARTS += ("planning", "schedules", "replanning", "world_model", "journal")
PARTS += ("simulation", "simulator", "use_case", "bags", "window")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, default=ROOT / "build/bench.json", help="where the figures go")
    parser.add_argument("parts", nargs="*", default=PARTS, help=f"what to measure: {', '.join(PARTS)} (default: all)")
    arguments = parser.parse_args()
    unknown = set(arguments.parts) - set(PARTS)
    if unknown:
        parser.error(f"no part {', '.join(sorted(unknown))}; there are: {', '.join(PARTS)}")

    done: list[Measurement] = []
    with tempfile.TemporaryDirectory(prefix="skiros2-bench-") as folder, ExitStack() as stack:
        node = _Node(Path(folder), stack)
        for part in arguments.parts:
            print(f"measuring {part} ...", file=sys.stderr, flush=True)
            for measurement in _measure(part, Path(folder), node):
                print(f"    {measurement.name}: ratio {measurement.ratio:.2f}", file=sys.stderr, flush=True)
                done.append(measurement)
    print(table(done))
    arguments.json.parent.mkdir(parents=True, exist_ok=True)
    arguments.json.write_text(json.dumps([m.as_json() for m in done], indent=2) + "\n")
    return 0


def _measure(part: str, folder: Path, node: _Node) -> Iterator[Measurement]:
    if part == "launch":
        from benchmarks import launch

        return launch.measure(folder)
    if part == "ticks":
        from benchmarks import ticks

        return ticks.measure()
    if part == "inference":
        from benchmarks import inference

        return inference.measure()
    if part == "planning":
        from benchmarks import planning

        return planning.measure(folder)
    if part == "schedules":
        from benchmarks import schedules

        return schedules.measure()
    if part == "replanning":
        from benchmarks import replanning

        return replanning.measure()
    if part == "journal":
        from benchmarks import journal

        return journal.measure(folder)
    if part == "world_model":
        from benchmarks import world_model

        return world_model.measure(folder)
    if part == "bags":
        from benchmarks import bags

        return bags.measure(folder)
    if part == "use_case":
        from benchmarks import use_case

        return use_case.measure(folder)
    if part == "simulation":
        from benchmarks import simulation

        return simulation.measure()
    if part == "simulator":
        from benchmarks import simulation

        return node.measure(simulation.measure_node)
    if part == "tf":
        from benchmarks import tf

        return node.measure(tf.measure)
    if part == "window":
        from benchmarks import window

        return node.measure(window.measure)
    if part == "skills":
        from benchmarks import skills

        return node.measure(skills.measure)
    if part == "updates":
        from benchmarks import updates

        return node.measure(updates.measure)
    from benchmarks import services

    return node.measure(services.measure)


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
