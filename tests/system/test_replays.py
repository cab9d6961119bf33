"""Recorded runs played again on real nodes: what has not changed passes, and each planted change is found where it can
be seen."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from support.programs import Program, descendants
from support.ros import ROOT, install_environment, wait_until

BAG = ROOT / "tests" / "bags" / "timed_drive.bag"
WORKSPACE = ROOT / "skiros2_std_lib" / "skiros2_demo_skills" / "owl"

#: How Python runs the program, and the plugin of pytest.
PROGRAM = ("-m", "skiros2_bags.testing.replay_program")
PLUGIN = ("-m", "pytest", "-p", "skiros2_bags.testing", "-p", "no:cacheprovider")

pytestmark = pytest.mark.timeout(240)


@dataclass(frozen=True)
class Planted:
    """A change in the code of a package: a text in one of its files, and what it becomes."""

    package: str
    file: str
    text: str
    becomes: str

    def plant(self, folder: Path) -> Path:
        """Copies the package to the folder with changes. Returns the entry for Python's path."""
        source = next(ROOT.glob(f"skiros2*/{self.package}/src/{self.package}"))
        copy = Path(tempfile.mkdtemp(dir=folder)) / self.package
        shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__"))
        file = copy / self.file
        content = file.read_text()
        assert content.count(self.text) == 1, f"{self.text!r} in {file}"
        file.write_text(content.replace(self.text, self.becomes))
        return copy.parent


SKILL = Planted(
    "skiros2_demo_skills", "transport_skills.py",
    '"skiros:at", "RelationState": True', '"skiros:at", "RelationState": False',
)  # fmt: skip
CONDITION = Planted(
    "skiros2_demo_skills", "transport_skills.py",
    '"RobotElsewhere", "skiros:at", "Robot", "TargetLocation", False',
    '"RobotElsewhere", "skiros:at", "Robot", "TargetLocation", True',
)  # fmt: skip
PLANNER = Planted("skiros2_task", "core/task.py", "return holds(self.goal, self.init)", "return True")
ENDLESS = Planted(
    "skiros2_demo_skills", "timed_motions.py", "if passed < duration:", "if passed < 1000 * duration:"
)  # fmt: skip


def planted(change: Planted | None, folder: Path) -> dict[str, str]:
    """The environment of a program that has the change."""
    environment = dict(install_environment())
    if change is not None:
        environment["PYTHONPATH"] = f"{change.plant(folder)}:{environment['PYTHONPATH']}"
    return environment


def played(kind: str, change: Planted | None, folder: Path) -> tuple[int, str]:
    """Plays the bag again. Returns the status of the program, and what it says."""
    environment = planted(change, folder)
    command = [sys.executable, *PROGRAM, str(BAG), kind, "--workspace", str(WORKSPACE)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200)
    return done.returncode, done.stdout + done.stderr


TRACE_CASES = [
    (None, 0, "as recorded"),
    (SKILL, 1, "no longer skiros:at"),
    (CONDITION, 1, "no such task"),
    (PLANNER, 1, "the end of goal"),
]


def test_trace_finds_exactly_the_planted_changes(tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda case: played("trace", case[0], tmp_path), TRACE_CASES))
    for (change, status, text), (got, said) in zip(TRACE_CASES, found, strict=True):
        assert (got, text in said) == (status, True), f"{change}: status {got}\n{said}"


@pytest.mark.parametrize(
    ("arguments", "number", "status"),
    [
        ((*PROGRAM, str(BAG), "trace"), signal.SIGTERM, 128 + signal.SIGTERM),
        ((*PLUGIN, "--replay", str(BAG), "--replay-kind", "trace"), signal.SIGHUP, -signal.SIGHUP),
    ],
    ids=["program", "pytest"],
)
def test_terminated_replay_ends_its_nodes(
    arguments: tuple[str, ...], number: int, status: int, tmp_path: Path
) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    environment = {**planted(ENDLESS, tmp_path), "TMPDIR": str(temporary)}
    program = Program([sys.executable, *arguments], environment, cwd=tmp_path)
    try:
        wait_until(lambda: any("skill_manager_node" in str(p) for p in descendants(program.pid)), 60, "a skill manager")
        family = descendants(program.pid)
        os.kill(program.pid, number)
        assert program.wait() == status
        wait_until(lambda: not any(process.running for process in family), what="the end of all nodes")
        assert list(temporary.iterdir()) == []
    finally:
        program.stop()
