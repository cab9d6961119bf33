"""Declared and measured durations of skills."""

from __future__ import annotations

import json
import logging
import math
import threading
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_task.core.skills import Skill, read_robots
from skiros2_task.core.store import DEFAULT_DURATION, MAX_RUNS, Durations
from skiros2_task.core.world import WorldView
from support.planning_world import DRIVE, PlanningWorld, skill

PICK, PLACE = (Skill(f"skiros:{name}", name.lower(), (), (), (), ()) for name in ("Pick", "Place"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "planner" / "durations.json"


def test_unknown_skill_has_default_duration() -> None:
    assert Durations().seconds(PICK, "/alpha") == DEFAULT_DURATION == 1.0


def test_measured_duration_is_median() -> None:
    durations = Durations()
    for seconds in (2.0, 90.0, 3.0):
        durations.record(PICK, "/alpha", seconds)
    assert durations.seconds(PICK, "/alpha") == 3.0
    assert durations.seconds(PLACE, "/alpha") == DEFAULT_DURATION


def test_new_manager_has_median_of_all_managers() -> None:
    durations = Durations()
    durations.record(PICK, "/alpha", 2.0)
    durations.record(PICK, "/beta", 4.0)
    assert (durations.seconds(PICK, "/alpha"), durations.seconds(PICK, "/gamma")) == (2.0, 3.0)


def test_declared_duration_overrides_measured() -> None:
    given = Skill("skiros:Pick", "pick", (), (), (), (), duration=7.0)
    durations = Durations()
    durations.record(given, "/alpha", 2.0)
    assert durations.seconds(given, "/alpha") == 7.0


def test_old_runs_are_dropped() -> None:
    durations = Durations()
    for seconds in [100.0] * MAX_RUNS + [1.0] * MAX_RUNS:
        durations.record(PICK, "/alpha", seconds)
    assert durations.seconds(PICK, "/alpha") == 1.0


@pytest.mark.parametrize("seconds", [-1.0, math.nan, math.inf])
def test_invalid_duration_raises(seconds: float) -> None:
    with pytest.raises(WrongValue, match=r"skiros:Pick \(pick\) of /alpha took .*, expected seconds"):
        Durations().record(PICK, "/alpha", seconds)


# -- the file ---------------------------------------------------------------------------------------------------------


def test_recorded_durations_are_read_from_file(file: Path) -> None:
    Durations(file).record(PICK, "/alpha", 2.5)
    assert Durations(file).seconds(PICK, "/alpha") == 2.5


def test_concurrent_processes_share_file(file: Path) -> None:
    def run(manager: str) -> None:
        durations = Durations(file)
        for _ in range(10):
            durations.record(PICK, manager, 2.0)

    threads = [threading.Thread(target=run, args=(f"/robot{i}",)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    kept = json.loads(file.read_text())["skiros:Pick (pick)"]
    assert {manager: len(runs) for manager, runs in kept.items()} == {f"/robot{i}": 10 for i in range(4)}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "Expecting property name"),
        ("[]", "'list' object has no attribute 'items'"),
        ('{"a": 3}', "'int' object has no attribute 'items'"),
        ('{"a": {"/b": 3}}', "'int' object is not iterable"),
        ('{"a": {"/b": [-1]}}', "a of /b took -1, expected seconds"),
        ('{"a": {"/b": ["x"]}}', "a of /b took 'x', expected seconds"),
        ('{"a": {"/b": [NaN]}}', "a of /b took nan, expected seconds"),
    ],
)
def test_malformed_file_is_logged_and_replaced(
    file: Path, text: str, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    file.parent.mkdir()
    file.write_text(text)
    durations = Durations(file)
    assert f"durations in {file} are ignored: " in caplog.text and reason in caplog.text
    durations.record(PICK, "/alpha", 2.0)
    assert Durations(file).seconds(PICK, "/alpha") == 2.0


def test_unwritable_file_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("no folder")
    durations = Durations(tmp_path / "file" / "durations.json")
    durations.record(PICK, "/alpha", 2.0)
    assert "durations are not stored" in caplog.text
    assert durations.seconds(PICK, "/alpha") == 2.0


# -- in descriptions --------------------------------------------------------------------------------------------------


def test_declared_duration_reaches_planner() -> None:
    wait = skill("Wait")
    wait.set_duration(4)
    world = PlanningWorld()
    world.robot("alpha", wait, DRIVE)
    (robot,) = WorldView(world.wm).robots
    assert {s.label: s.duration for s in robot.skills} == {"wait": 4.0, "drive": None}


def test_implementation_inherits_declared_duration() -> None:
    class Lift(SkillDescription):
        def createDescription(self) -> None:
            self.set_duration(1.5)

    made = skill("Other")
    made.setDescription(Lift(), "lift")
    assert made.duration == 1.5


@pytest.mark.parametrize("seconds", [-1, math.nan, math.inf, True, "3", None])
def test_set_duration_raises_on_invalid_value(seconds: Any) -> None:
    with pytest.raises(WrongValue, match=r"the duration of skiros:SkillDescription is .*, expected seconds"):
        SkillDescription().set_duration(seconds)


@pytest.mark.parametrize("value", ["soon", -3.0])
def test_invalid_duration_in_world_model_is_logged(value: Any, caplog: pytest.LogCaptureFixture) -> None:
    world = PlanningWorld()
    world.robot("alpha", DRIVE)
    elements = {e.id: e for e in world.wm.resolve_elements(Element())}
    drive = next(e for e in elements.values() if e.label == "drive")
    drive.setProperty("skiros:Duration", value)
    with caplog.at_level(logging.WARNING):
        ((found,),) = [r.skills for r in read_robots(elements)]
    assert found.duration is None
    assert f"skill {drive.id}-drive: skiros:Duration is {value!r}, expected seconds" in caplog.text
