"""The demo in the simulated world, and its disturbances, with different seeds: how often it succeeds, and how soon.

Also a program of its own, for many runs: `.ci/in_ros .venv/bin/python3 tests/benchmarks/use_case.py --runs 20`.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from benchmarks.measurement import Measurement  # noqa: E402 - after the path
from support.ros import install_environment  # noqa: E402

#: What goes wrong -> the demo's arguments.
KINDS = {"undisturbed": (), "moved": ("--disturb", "moved"), "slip": ("--disturb", "slip")}
#: What one run may take from nothing to the proof (s).
LIMIT = 60.0
#: After so long a run counts as hung (s).
_TIMEOUT = 240.0


@dataclass(frozen=True)
class Run:
    """One run of the demo."""

    kind: str
    seed: int
    succeeded: bool
    seconds: float
    complaint: str


def measure(folder: Path, runs: int = 1) -> Iterator[Measurement]:
    """For each kind: the time of a run beside the limit, and how many of the runs failed."""
    for kind in KINDS:
        done = [run_demo(kind, seed, folder / "use_case") for seed in range(1, runs + 1)]
        seconds = statistics.median(run.seconds for run in done)
        failed = sum(not run.succeeded for run in done)
        yield Measurement(f"use case, {kind}", seconds, "s", runs, "limit", LIMIT, seconds / LIMIT, 1.0)
        yield Measurement(f"use case, {kind}: failed", failed, "runs", runs, "all runs", runs, failed / runs, 0.0)


def run_demo(kind: str, seed: int, folder: Path) -> Run:
    """Runs it once. What it printed, its bag and logs stay in `folder/KIND_SEED` when it failed."""
    place = folder / f"{kind}_{seed}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    environment = {key: value for key, value in install_environment().items() if key != "ROS_MASTER_URI"}
    command = ["rosrun", "skiros2_sim_skills", "pick_place_demo", "--seed", str(seed), "--folder", str(place)]
    output = place / "output.txt"
    began_at = time.monotonic()
    with output.open("wb") as log:
        demo = subprocess.Popen(
            [*command, *KINDS[kind]], env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
        )
        try:
            status = demo.wait(_TIMEOUT)
        except subprocess.TimeoutExpired:
            demo.terminate()  # it then ends all that it has started
            status = demo.wait()
    seconds = time.monotonic() - began_at
    complaint = "" if status == 0 else _complaint(output.read_text(errors="replace"))
    if status == 0:
        shutil.rmtree(place)
    return Run(kind, seed, status == 0, seconds, complaint)


def _complaint(text: str) -> str:
    """The lines that say what went wrong, or the last one."""
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["it said nothing"]
    return "; ".join([line for line in lines if line.startswith(("✗", "pick_place_demo:"))] or lines[-1:])


def told(runs: Iterable[Run]) -> list[str]:
    """Successes and times as a table, a line for each kind."""
    lines = [f"{'':<12}  {'succeeded':>9}  {'median':>7}  {'longest':>7}"]
    done = list(runs)
    for kind in dict.fromkeys(run.kind for run in done):
        seconds = [run.seconds for run in done if run.kind == kind]
        succeeded = sum(run.succeeded for run in done if run.kind == kind)
        share = f"{succeeded}/{len(seconds)}"
        lines.append(f"{kind:<12}  {share:>9}  {statistics.median(seconds):5.1f} s  {max(seconds):5.1f} s")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="of each kind, each with another seed (%(default)s)")
    parser.add_argument("--first", type=int, default=1, help="the first seed (%(default)s)")
    parser.add_argument("--folder", type=Path, default=ROOT / "build/use_case", help="for the runs that fail")
    parser.add_argument("kinds", nargs="*", default=list(KINDS), help=f"{', '.join(KINDS)} (default: all)")
    arguments = parser.parse_args()
    if unknown := set(arguments.kinds) - set(KINDS):
        parser.error(f"no kind {', '.join(sorted(unknown))}; there are: {', '.join(KINDS)}")
    done = []
    for seed in range(arguments.first, arguments.first + arguments.runs):
        for kind in arguments.kinds:
            run = run_demo(kind, seed, arguments.folder)
            print(f"{kind:<12} seed {seed:<3} {run.seconds:5.1f} s  {run.complaint or 'ok'}", flush=True)
            done.append(run)
    print("\n".join(["", *told(done)]))
    return 0 if all(run.succeeded for run in done) else 1


if __name__ == "__main__":
    sys.exit(main())
