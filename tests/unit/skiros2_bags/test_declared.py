"""A re-run compares what skills declare, also where it makes no difference in the recorded run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from skiros2_bags.testing.declared import Declared
from skiros2_bags.testing.recording import EvidenceEntries, Recording
from skiros2_bags.testing.rerun import ReplayResult, Settings, rerun
from skiros2_common.core.params import ParamTypes
from skiros2_demo_skills import timed_motions, transport_skills
from support.ros import ROOT

BAG = ROOT / "tests/bags/timed_pick_place.bag"
DRIVE = ROOT / "tests/bags/timed_drive.bag"
EARLIER = ROOT / "tests/bags/timed_goal.bag"
SETTINGS = Settings(ROOT / "skiros2_std_lib/demos/timed_skills/owl")

Change = Callable[[Any], None]
Rerun = Callable[..., ReplayResult]


def without(kind: str, label: str) -> Change:
    """Takes a condition out of a description: `_pre_conditions`, `_hold_conditions` or `_post_conditions`."""

    def change(description: Any) -> None:
        conditions = getattr(description, kind)
        conditions[:] = [c for c in conditions if c.label != label]
        assert len(conditions) > 0

    return change


def with_duration(duration: float, **limits: Any) -> Change:
    def change(motion: Any) -> None:
        motion.addParam("Duration", duration, ParamTypes.Optional, description="Duration of the motion", **limits)

    return change


@pytest.fixture
def changed(monkeypatch: pytest.MonkeyPatch) -> Rerun:
    """Re-runs the bag with a class whose description is changed after it was created."""

    def run(cls: Any, change: Change, bag: Path = BAG) -> ReplayResult:
        genuine = cls.createDescription

        def described(self: Any) -> None:
            genuine(self)
            change(self)

        monkeypatch.setattr(cls, "createDescription", described)
        recording = Recording(bag)
        recording.events = [event for event in recording.events if not isinstance(event, EvidenceEntries)]
        return rerun(recording, SETTINGS)

    return run


PICK = "skill pick"
ARM = "skill move_arm_timed"


@pytest.mark.parametrize(
    ("cls", "change", "line"),
    [
        (
            transport_skills.Pick,
            without("_pre_conditions", "GripperEmpty"),
            f"{PICK}: pre-condition GripperEmpty: recorded, not declared now",
        ),
        (
            transport_skills.Pick,
            without("_post_conditions", "GripperNotEmpty"),
            f"{PICK}: post-condition GripperNotEmpty: recorded, not declared now",
        ),
        (
            transport_skills.Pick,
            lambda d: d.addHoldCondition(d.getRelationCond("Held", "skiros:at", "Robot", "Container", False)),
            f"{PICK}: hold-condition Held: not recorded, declared now",
        ),
        (
            timed_motions.move_arm_timed,
            with_duration(1.0, unit="s", minimum=-1),
            f"{ARM}: parameter Duration minimum: recorded 0, now -1",
        ),
        (
            timed_motions.move_arm_timed,
            with_duration(1.0, unit="ms", minimum=0),
            f'{ARM}: parameter Duration unit: recorded "s", now "ms"',
        ),
        (
            timed_motions.tuck_arm_timed,
            lambda d: d.params.addParam("Unused", 8.0, ParamTypes.Optional, "Read by nobody in this run"),
            "skill tuck_arm_timed: parameter Unused: not recorded, declared now",
        ),
    ],
)
def test_change_without_effect_in_the_run_is_found(changed: Rerun, cls: type, change: Change, line: str) -> None:
    found = changed(cls, change)
    assert found.divergence is None
    assert not found.is_as_recorded
    assert list(found.declared) == [line]
    assert f"declared differently: {line}" in str(found)


def test_earlier_recording_says_that_declarations_are_not_compared() -> None:
    found = rerun(Recording(EARLIER), SETTINGS)
    assert found.is_as_recorded
    assert found.not_compared[0] == "what skills declare: the recording does not have it; record the run again"
    assert found.not_compared[1].startswith("which conditions are evaluated, which hooks are called")


def test_skill_that_the_run_does_not_use_is_not_compared(changed: Rerun) -> None:
    assert changed(transport_skills.Pick, without("_pre_conditions", "GripperEmpty"), DRIVE).is_as_recorded


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "cannot be read: JSONDecodeError"),
        ("[]", "cannot be read: TypeError"),
        ('{"version": 1, "skills": [{"label": "pick"}]}', "cannot be read: KeyError('declares')"),
        ('{"version": 1, "skills": [{"label": "pick", "declares": {"": 5}}]}', "cannot be read: TypeError"),
        ('{"version": 2}', "has version 2 of it, expected 1"),
    ],
)
def test_declarations_that_cannot_be_read_are_not_compared(text: str, problem: str) -> None:
    found = Declared(text)
    assert found.differences([], ["pick"]) == []
    assert len(found.not_compared) == 1 and problem in found.not_compared[0]
