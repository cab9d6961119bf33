"""A goal that a skill hands to the task manager: its final failure is final in the tree that asked for it, too."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.failure_kind import FailureKind
from skiros2_msgs.msg import AchieveResult
from skiros2_skill.core.skill import RetryOnFail, SelectorStar, Skill
from skiros2_skill.testing import SkillBench
from skiros2_std_skills.achieve import achieve

ABORTED = 4


@pytest.mark.parametrize("kind", list(FailureKind))
def test_failure_of_a_nested_goal_keeps_its_kind(
    skill_bench: SkillBench, kind: FailureKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    why = Explanation("execute", "move", "robot", -1, -121, "stopped", kind=kind.value)
    result = AchieveResult(message="step 1 failed", explanations=json.dumps([dataclasses.asdict(why)]))
    asked: list[Any] = []

    def start(skill: Any) -> bool:
        asked.append(skill)
        return True

    client = SimpleNamespace(action_client=SimpleNamespace(stop=lambda: None))
    monkeypatch.setattr(achieve, "buildClient", lambda skill: client)
    monkeypatch.setattr(achieve, "onStart", start)
    monkeypatch.setattr(achieve, "execute", lambda skill: skill.onDone(ABORTED, result))
    monkeypatch.setattr(achieve, "onEnd", lambda skill: True)
    skill_bench.load(achieve)
    first, other = (skill_bench.node("Achieve", Goal="(at home)") for _ in range(2))
    task = skill_bench.task(Skill("", SelectorStar())(Skill("", RetryOnFail(2))(first), other))
    task.tick(10)
    assert task.state is State.Failure
    assert task.cause().failure_kind is kind
    assert len(asked) == (1 if kind.is_final else 4), "three attempts, then the other branch"
