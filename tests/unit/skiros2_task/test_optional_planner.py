"""Fast Downward is optional: without it, everything but planning works."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from skiros2_task.core.engines import EngineProcesses, Limits, Outcome
from skiros2_task.core.planners import planner_named
from support.ros import ROOT
from support.transport_task import transport_task

_IMPORT_ALL = """
import importlib, pkgutil, sys
for name in sys.argv[1:]:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, f"{name}."):
        importlib.import_module(module.name)
"""


@pytest.fixture
def without_planner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stands in for an environment in which Fast Downward is not installed."""
    for package in ("fast_downward", "up_fast_downward"):
        text = f"No module named {package!r}"
        (tmp_path / f"{package}.py").write_text(f"raise ModuleNotFoundError({text!r}, name={package!r})\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("quality", ["first", "optimal"])
def test_planning_without_the_planner_fails_with_one_clear_message(without_planner: Path, quality: str) -> None:
    processes = EngineProcesses()
    try:
        answer = planner_named(processes, quality).solve(transport_task(1, 2, 1), Limits(seconds=60.0))
    finally:
        processes.close()
    assert answer.outcome is Outcome.FAILED
    assert answer.reason.startswith("the planner Fast Downward is not installed (requirements/planner.txt)")


def test_engines_that_happen_to_be_installed_are_imported_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, package = tmp_path / "log", tmp_path / "up_tamer"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "engine.py").write_text(f"open({str(log)!r}, 'a').write('imported\\n')\nraise ImportError\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    processes = EngineProcesses()
    try:
        planner = planner_named(processes, "first")
        answers = [planner.solve(transport_task(1, 2, 1), Limits(seconds=60.0)) for _ in range(3)]
    finally:
        processes.close()
    assert [answer.outcome for answer in answers] == [Outcome.SOLVED] * 3
    assert log.read_text() == "imported\n"


def test_all_modules_of_the_platform_import_without_the_planner(without_planner: Path) -> None:
    packages = ("skiros2_common", "skiros2_world_model", "skiros2_skill", "skiros2_task", "skiros2_std_skills")
    folders = [str(without_planner), *(path for path in sys.path if path)]
    subprocess.run(
        [sys.executable, "-c", _IMPORT_ALL, *packages], cwd=ROOT, env={"PYTHONPATH": ":".join(folders)}, check=True
    )
