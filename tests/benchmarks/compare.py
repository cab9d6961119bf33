"""Compares the figures of this checkout with those of another commit, in runs that alternate: `make bench COMPARE=REV`.

The other commit is checked out and set up in `build/compare`, and measured by its own benchmarks: what only one of the
two measures is named, not compared.
"""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

#: What is slower than this ratio is named (`CONTRIBUTING.md`: nothing becomes slower by more than 10 %).
SLOWER = 1.1
#: The order of the runs: a machine whose speed drifts slows both alike.
_ORDER = ("ours", "theirs", "theirs", "ours")

Figures = dict[str, list[float]]


def compare(root: Path, revision: str, parts: Sequence[str]) -> int:
    """Measures both commits, prints the figures, and those that are slower now. Takes four times as long as one run.

    :param root: this checkout.
    :returns: the exit status: 1 if something is slower, or was not measured to the end.
    """
    is_whole, slower = True, []
    with _checkout(root, revision) as other:
        for part in parts:
            figures: dict[str, Figures] = {"ours": defaultdict(list), "theirs": defaultdict(list)}
            for whose in _ORDER:
                is_whole &= _measure(root if whose == "ours" else other, part, figures[whose])
            slower += _report(figures["ours"], figures["theirs"], revision)
    print("\n".join([f"slower by more than {SLOWER - 1:.0%}:", *slower]) if slower else "nothing is slower")
    if not is_whole:
        print("not everything was measured to the end, see above", file=sys.stderr)
    return 0 if is_whole and not slower else 1


@contextlib.contextmanager
def _checkout(root: Path, revision: str) -> Iterator[Path]:
    """A worktree of another commit, set up; it is removed at the end."""
    folder = root / "build/compare"
    git = ["git", "-C", str(root), "worktree"]
    subprocess.run([*git, "add", "--force", "--detach", str(folder), revision], check=True, stdout=subprocess.DEVNULL)
    try:
        subprocess.run(["make", "setup"], cwd=folder, check=True, stdout=sys.stderr, env=_outside())
        planners = [".venv/bin/python3", "-m", "pip", "install", "--quiet", "--requirement", "requirements/bench.txt"]
        subprocess.run(planners, cwd=folder, stdout=sys.stderr, env=_outside())  # without: parts say what is missing
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def _outside() -> dict[str, str]:
    """The environment without this checkout's paths and make's own variables."""
    ours = ("PYTHONPATH", "MAKEFLAGS", "MAKELEVEL", "MFLAGS", "VIRTUAL_ENV", "CMAKE_PREFIX_PATH", "ROS_PACKAGE_PATH")
    return {key: value for key, value in os.environ.items() if key not in ours}


def _measure(checkout: Path, part: str, figures: Figures) -> bool:
    """Runs one part of the bench in a checkout, and adds its figures. Returns whether it ran to its end."""
    with tempfile.TemporaryDirectory(prefix="skiros2-bench-") as folder:
        target = Path(folder) / "bench.json"
        command = [".ci/in_ros", ".venv/bin/python3", "tests/benchmarks/run.py", "--json", str(target), part]
        ran = subprocess.run(command, cwd=checkout, env=_outside(), stdout=subprocess.DEVNULL)
        for row in json.loads(target.read_text()) if target.is_file() else ():
            figures[f"{row['name']} ({row['unit']})"].append(row["median"])
    return ran.returncode == 0


def _report(ours: Figures, theirs: Figures, revision: str) -> list[str]:
    """Prints the figures of a part; returns the lines of those that are slower."""
    slower = []
    for name in ours:
        if name not in theirs:
            print(f"  {name}: measured here only")
            continue
        now, before = statistics.median(ours[name]), statistics.median(theirs[name])
        line = f"  {name}: {now:.3g}, {revision}: {before:.3g}, ratio {now / before:.2f}"
        print(line, flush=True)
        if now > SLOWER * before and min(ours[name]) > max(theirs[name]):  # one run beside another load does not count
            slower.append(line)
    for name in theirs.keys() - ours.keys():
        print(f"  {name}: measured in {revision} only")
    return slower
