"""Values of an insertion from the properties of part and bore."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_contact_skills.core.evidence import Evidence, FloorTest
from skiros2_contact_skills.fit import Fit, fit_of
from skiros2_motion.core.geometry import IDENTITY, Pose
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core import spatial_data as space


def fit(bench: SkillBench, bore: dict[str, Any], part: dict[str, Any] | None = None, covariance: str = "") -> Fit:
    block = bench.add("skiros:Product", "block", bench.robot, "skiros:contain")
    hole = bench.add("skiros:Bore", "bore", block, "skiros:hasA")
    piston = bench.add("skiros:Product", "piston", bench.robot, "skiros:contain")
    space.set_pose(block, Pose((1.0, 0.0, 0.0), IDENTITY.orientation))
    space.set_pose(hole, Pose((0.1, 0.0, 0.05), IDENTITY.orientation))
    if covariance:
        block.setProperty("skiros:PoseCovariance", covariance)
    for element, values in ((hole, bore), (piston, part or {}), (block, {})):
        for key, value in values.items():
            element.setProperty(f"skiros:{key}", value)
        bench.wmi.update_element_properties(element)
    return fit_of(bench.wmi, piston, hole)


def test_silent_world_model_leaves_the_usual_values(skill_bench: SkillBench) -> None:
    assert fit(skill_bench, {}) == Fit() == fit_of(skill_bench.wmi, None, None)


def test_depth_clearance_attempts_and_radius_are_those_of_bore_and_part(skill_bench: SkillBench) -> None:
    size = {"SizeX": 0.04, "SizeY": 0.04, "SizeZ": 0.1}
    found = fit(
        skill_bench, {"Depth": 0.04, "Diameter": 0.0402, "SearchRadius": 0.002}, size | {"InsertionAttempts": 2}
    )
    assert found.depth == 0.04
    assert found.clearance == pytest.approx(0.0002)
    assert found.search_radius == 0.002
    assert found.attempts == 2


def test_bore_takes_precedence_over_the_part(skill_bench: SkillBench) -> None:
    assert fit(skill_bench, {"InsertionAttempts": 3}, {"InsertionAttempts": 2}).attempts == 3


def test_chamfer_is_not_taken_for_the_bore(skill_bench: SkillBench) -> None:
    assert fit(skill_bench, {"Depth": 0.06, "Chamfer": 0.002}).drop_depth == pytest.approx(0.0032)
    assert fit(skill_bench, {"Depth": 0.002}).drop_depth == 0.001


def test_radius_of_the_world_model_takes_precedence_over_the_covariance(skill_bench: SkillBench) -> None:
    covariance = json.dumps(np.diag([0.001**2] * 6).ravel().tolist())
    assert fit(skill_bench, {"SearchRadius": 0.004}, covariance=covariance).search_radius == 0.004


def test_radius_covers_the_error_of_an_estimated_pose(skill_bench: SkillBench) -> None:
    covariance = json.dumps(np.diag([0.0005**2] * 3 + [1e-12] * 3).ravel().tolist())
    assert fit(skill_bench, {}, covariance=covariance).search_radius == pytest.approx(0.0035, abs=1e-5)


@pytest.mark.parametrize(
    ("bore", "text"),
    [
        ({"Depth": -1.0}, "bore: skiros:Depth is -1.0, expected a number of 0 or more"),
        ({"InsertionAttempts": 0}, "skiros:InsertionAttempts is 0, expected 1, 2"),
    ],
)
def test_unusable_property_is_named(skill_bench: SkillBench, bore: dict[str, Any], text: str) -> None:
    with pytest.raises(WrongValue, match=text):
        fit(skill_bench, bore)


@pytest.mark.parametrize(("width", "lost"), [(0.0205, False), (0.0, True), (0.08, True), (0.03, True)])
def test_part_is_lost_when_the_fingers_are_not_where_they_gripped_it(width: float, lost: bool) -> None:
    evidence = Evidence(opening=0.08, wanted_depth=0.06, part_width=0.02)
    evidence.see_fingers(width)
    assert evidence.is_lost() is lost
    assert evidence.values()["held"] is not lost


def test_fingers_that_are_not_measured_are_no_evidence() -> None:
    evidence = Evidence(opening=0.08, wanted_depth=0.06)
    evidence.see_fingers(None)
    assert not evidence.is_lost()
    assert evidence.values()["used"] == ["tool"] and "held" not in evidence.values()


def test_floor_withstands_the_force_for_some_time_and_yields_to_none() -> None:
    test = FloorTest(0.06, 0.0, 18.0, 2000.0, excess=2.0)
    assert not test.has_passed(5.0, 0.1)
    assert not test.has_passed(15.0, 0.2)
    assert test.has_passed(15.0, 0.4)
    assert test.has_yielded(0.0606) and not test.has_yielded(0.0604)


def test_push_on_what_moves_leads_by_little_more_than_its_friction() -> None:
    """A part that moves is not on the floor: friction withstands the push, and may end at once."""
    push = FloorTest(0.06, 0.0, 18.0, 2000.0, excess=2.0)
    while (lead := push.lead(10.0, 0.06, 0.04)) < 0.007:
        pass
    assert lead > 12.0 / 2000.0, "what does not move is pushed with the whole force"
    assert push.lead(3.0, 0.0602, 0.04) == pytest.approx(5.0 / 2000.0)
    assert push.lead(-1.0, 0.0604, 0.04) == pytest.approx(2.0 / 2000.0)
