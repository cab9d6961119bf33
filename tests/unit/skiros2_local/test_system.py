"""A whole system in one process: goals are planned and executed, and end in each of the ways that they can."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import skiros2_skill
from skiros2_common.core.errors import ConfigurationError, SkirosError, UnknownName
from skiros2_local import LocalSystem
from skiros2_runs.core.progress import has_ended
from skiros2_task.core.step_record import StepState

TEMPLATE = Path(skiros2_skill.__file__).parent / "templates" / "my_skills"
TIMEOUT = 30.0
INSPECTED = "(my_skills:Inspected skiros:Product-5)"


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> Iterator[LocalSystem]:
    """The package that `new` makes, with its robot."""
    monkeypatch.syspath_prepend(TEMPLATE / "src")
    seen = []
    with LocalSystem(TEMPLATE / "owl/scene.ttl", seen.append) as made:
        made.seen = seen
        made.add_robot("my_skills:my_robot", ["my_skills"], ["drive", "take_picture"])
        yield made


def test_goal_is_planned_and_reached(system: LocalSystem) -> None:
    at_shelf = f"(skiros:at {system.element('my_skills:my_robot').id} {system.element('Shelf A').id})"
    goal = system.achieve(at_shelf).wait(TIMEOUT)
    assert goal.reached, goal.message
    assert [(record.step.call.label, record.state) for record in goal.steps] == [("drive", StepState.SUCCEEDED)]
    assert has_ended(system.seen[-1])
    assert system.achieve(at_shelf).wait(TIMEOUT).reached
    assert len({nodes[0].id for nodes in system.seen}) == 1


def test_goal_without_a_plan_says_why(system: LocalSystem) -> None:
    goal = system.achieve(INSPECTED).wait(TIMEOUT)
    assert goal.has_ended
    assert not goal.reached
    assert "no skill achieves it" in goal.message


def test_cancelled_goal_stops_its_robot(system: LocalSystem) -> None:
    driving = threading.Event()
    goal = system.achieve("(skiros:at cora:Robot-1 my_skills:Shelf-3)", lambda goal: goal.steps and driving.set())
    assert driving.wait(TIMEOUT)
    goal.cancel()
    assert not goal.wait(TIMEOUT).reached
    assert [record.state for record in goal.steps] == [StepState.STOPPED]
    assert system.world.get_relations("cora:Robot-1", "skiros:at", "skiros:Location-2")


def test_failed_skill_is_explained(system: LocalSystem) -> None:
    robot = system.robots["/my_robot"]
    results, ended = [], threading.Event()

    def end(*result: object) -> None:
        results.append(result)
        ended.set()

    robot.start("skiros:Drive", "", {"TargetLocation": system.element("Dock")}, end)
    assert ended.wait(TIMEOUT)
    ((succeeded, message, explanations),) = results
    assert (succeeded, message) == (False, "drive did not start: my_robot is at Dock.")
    assert "RobotElsewhere" in str(explanations[0])
    assert str(robot.why()).splitlines()[0] == message


def test_wrong_request_is_refused_with_its_reason(system: LocalSystem) -> None:
    robot = system.robots["/my_robot"]
    with pytest.raises(SkirosError, match="Exposure"):
        robot.start("TakePicture", "", {"Object": system.element("Bolt 1"), "Exposure": -1.0}, lambda *_: None)


def test_unknown_names_are_errors(system: LocalSystem) -> None:
    with pytest.raises(UnknownName, match="Bolt 1, Bolt 2"):
        system.element("Bolt 3")
    with pytest.raises(ConfigurationError, match="nobody"):
        system.add_robot("my_skills:nobody", ["my_skills"], ["drive"])
    with pytest.raises(ConfigurationError, match="there is a robot /my_robot already"):
        system.add_robot("my_skills:my_robot", ["my_skills"], ["drive"])
