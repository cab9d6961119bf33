"""Executions on running nodes whose tasks fail finally, with a stand-in for the skill manager."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.explanation import EXECUTE, Explanation
from skiros2_common.core.failure_kind import FailureKind
from skiros2_learning.core.evaluation import Evaluation, Unavailable, evaluate
from skiros2_learning.core.scenario import parse_scenario
from skiros2_learning.ros import real_robot

SCENARIO = """
scenario: real
platform: real
real: {reset: [{skill: Home}], signals: {}}
task: [{skill: Push}]
variables:
  Push.Speed: {type: real, range: [0, 1]}
objectives:
  done: {rewards: [{reward: success}]}
repetitions: 2
"""


class Goal:
    """A task that has ended."""

    done = True

    def __init__(self, kind: FailureKind | None) -> None:
        self._kind = kind

    def wait(self, timeout: float) -> bool:
        return True

    def succeeded(self) -> bool:
        return self._kind is None

    def explanations(self) -> list[Explanation]:
        kind = self._kind
        return [] if kind is None else [Explanation(EXECUTE, "Push", "push", 1, -1, "it has failed", kind=kind.value)]


class Manager:
    """A skill manager whose skills end as they are listed; those not listed succeed."""

    name = "/robot"

    def __init__(self, **kinds: FailureKind) -> None:
        self._kinds = kinds
        self.ran: list[str] = []

    def preview(self, skills: Any, partial: bool = False) -> Any:
        return SimpleNamespace(refusal=None)

    def read_skills(self) -> list[Any]:
        return []

    def run(self, skills: Any) -> Goal:
        self.ran += [skill.type for skill in skills]
        return Goal(self._kinds.get(skills[-1].type))

    def close(self) -> None:
        pass


def evaluated(manager: Manager, patch: pytest.MonkeyPatch) -> Evaluation:
    patch.setattr(real_robot, "connect", lambda *_: manager)
    patch.setattr(real_robot, "become_node", lambda name: None)
    world_model = SimpleNamespace(catch_up=lambda: None, get_scene_elements=list)
    patch.setattr(real_robot, "WorldModelInterface", lambda name: world_model)
    patch.setattr(real_robot.rospy, "get_name", lambda: "/learn")
    patch.setattr(real_robot, "RosSignals", lambda: SimpleNamespace(now=lambda: 0.0, close=lambda: None))
    scenario = parse_scenario(SCENARIO, Path("/"))
    with real_robot.RealRobot(scenario, lambda text: True) as robot:
        return evaluate(scenario, {"Push.Speed": 0.5}, 0, robot.execute)


@pytest.mark.parametrize("kind", [FailureKind.RETRYABLE, FailureKind.LIMIT])
def test_execution_that_fails_or_ends_at_a_limit_is_a_result(
    kind: FailureKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    manager = Manager(Push=kind)
    found = evaluated(manager, monkeypatch)
    assert [each.is_success for each in found.repetitions] == [False, False]
    assert manager.ran == ["Home", "Push", "Home", "Push"]


@pytest.mark.parametrize("kind", [FailureKind.LOST, FailureKind.SENSOR, FailureKind.CONTROLLER, FailureKind.SAFETY])
def test_execution_after_which_a_person_has_to_look_ends_the_run(
    kind: FailureKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    manager = Manager(Push=kind)
    with pytest.raises(Unavailable, match=f"{kind.words}.*a person has to look before the next execution"):
        evaluated(manager, monkeypatch)
    assert manager.ran == ["Home", "Push"]


def test_failed_reset_is_not_retried(monkeypatch: pytest.MonkeyPatch) -> None:
    manager = Manager(Home=FailureKind.LIMIT)
    with pytest.raises(Unavailable, match="the reset has failed: it has failed"):
        evaluated(manager, monkeypatch)
    assert manager.ran == ["Home"]
