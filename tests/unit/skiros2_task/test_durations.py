"""How long skills take: given with the skill, or learned."""

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
from skiros2_task.core.durations import KEPT, UNKNOWN, Durations
from skiros2_task.core.skill_model import Skill, read_robots
from skiros2_task.core.world_view import WorldView
from support.planning_world import DRIVE, PlanningWorld, skill

PICK, PLACE = (Skill(f"skiros:{name}", name.lower(), (), (), (), ()) for name in ("Pick", "Place"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "planner" / "durations.json"


def test_a_skill_of_which_nothing_is_known_takes_a_second() -> None:
    assert Durations().seconds(PICK, "/alpha") == UNKNOWN == 1.0


def test_what_was_measured_counts_by_its_median() -> None:
    durations = Durations()
    for seconds in (2.0, 90.0, 3.0):
        durations.learn(PICK, "/alpha", seconds)
    assert durations.seconds(PICK, "/alpha") == 3.0
    assert durations.seconds(PLACE, "/alpha") == UNKNOWN


def test_a_manager_that_has_not_run_a_skill_yet_is_taken_to_be_as_fast_as_the_others() -> None:
    durations = Durations()
    durations.learn(PICK, "/alpha", 2.0)
    durations.learn(PICK, "/beta", 4.0)
    assert (durations.seconds(PICK, "/alpha"), durations.seconds(PICK, "/gamma")) == (2.0, 3.0)


def test_what_a_description_gives_counts_before_what_was_measured() -> None:
    given = Skill("skiros:Pick", "pick", (), (), (), (), duration=7.0)
    durations = Durations()
    durations.learn(given, "/alpha", 2.0)
    assert durations.seconds(given, "/alpha") == 7.0


def test_only_the_last_runs_count() -> None:
    durations = Durations()
    for seconds in [100.0] * KEPT + [1.0] * KEPT:
        durations.learn(PICK, "/alpha", seconds)
    assert durations.seconds(PICK, "/alpha") == 1.0


@pytest.mark.parametrize("seconds", [-1.0, math.nan, math.inf])
def test_what_is_no_duration_is_refused(seconds: float) -> None:
    with pytest.raises(WrongValue, match=r"skiros:Pick \(pick\) of /alpha took .*, expected seconds"):
        Durations().learn(PICK, "/alpha", seconds)


# -- the file ---------------------------------------------------------------------------------------------------------


def test_what_was_learned_is_there_for_the_next_program(file: Path) -> None:
    Durations(file).learn(PICK, "/alpha", 2.5)
    assert Durations(file).seconds(PICK, "/alpha") == 2.5


def test_programs_that_learn_at_the_same_time_keep_what_each_has_learned(file: Path) -> None:
    def run(manager: str) -> None:
        durations = Durations(file)
        for _ in range(10):
            durations.learn(PICK, manager, 2.0)

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
        ("[]", "the file: expected an object"),
        ('{"a": 3}', "a: expected an object"),
        ('{"a": {"/b": 3}}', "a of /b: expected a list"),
        ('{"a": {"/b": [-1]}}', "a of /b: -1 is no duration"),
        ('{"a": {"/b": ["x"]}}', "a of /b: 'x' is no duration"),
        ('{"a": {"/b": [NaN]}}', "a of /b: nan is no duration"),
    ],
)
def test_a_file_that_holds_no_durations_is_told_and_written_anew(
    file: Path, text: str, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    file.parent.mkdir()
    file.write_text(text)
    durations = Durations(file)
    assert f"the durations in {file} are not used: " in caplog.text and reason in caplog.text
    durations.learn(PICK, "/alpha", 2.0)
    assert Durations(file).seconds(PICK, "/alpha") == 2.0


def test_a_file_that_cannot_be_written_does_no_harm(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("no folder")
    durations = Durations(tmp_path / "file" / "durations.json")
    durations.learn(PICK, "/alpha", 2.0)
    assert "durations are not kept" in caplog.text
    assert durations.seconds(PICK, "/alpha") == 2.0


# -- in descriptions --------------------------------------------------------------------------------------------------


def test_a_duration_goes_with_the_skill_from_its_description_to_the_planner() -> None:
    wait = skill("Wait")
    wait.set_duration(4)
    world = PlanningWorld()
    world.robot("alpha", wait, DRIVE)
    (robot,) = WorldView(world.wm).robots
    assert {s.label: s.duration for s in robot.skills} == {"wait": 4.0, "drive": None}


def test_an_implementation_takes_as_long_as_its_description_says() -> None:
    class Lift(SkillDescription):
        def createDescription(self) -> None:
            self.set_duration(1.5)

    made = skill("Other")
    made.setDescription(Lift(), "lift")
    assert made.duration == 1.5


@pytest.mark.parametrize("seconds", [-1, math.nan, math.inf, True, "3", None])
def test_a_description_refuses_what_is_no_duration(seconds: Any) -> None:
    with pytest.raises(WrongValue, match=r"the duration of skiros:SkillDescription is .*, expected seconds"):
        SkillDescription().set_duration(seconds)


@pytest.mark.parametrize("value", ["soon", -3.0])
def test_a_duration_in_the_world_model_that_is_none_is_told(value: Any, caplog: pytest.LogCaptureFixture) -> None:
    world = PlanningWorld()
    world.robot("alpha", DRIVE)
    elements = {e.id: e for e in world.wm.resolve_elements(Element())}
    drive = next(e for e in elements.values() if e.label == "drive")
    drive.setProperty("skiros:Duration", value)
    with caplog.at_level(logging.WARNING):
        ((found,),) = [r.skills for r in read_robots(elements)]
    assert found.duration is None
    assert f"skill {drive.id}-drive: skiros:Duration is {value!r}, expected seconds" in caplog.text
