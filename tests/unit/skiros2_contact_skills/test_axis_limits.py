"""Limits of single axes of a compound are those of all its motions."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills import descriptions, insertion, plugging
from skiros2_skill.testing import SkillBench
from support.connector_cell import PLUG, SCENE, SOCKET

MOTIONS = (
    descriptions.ApproachTarget,
    descriptions.MoveUntilContact,
    descriptions.SpiralSearch,
    descriptions.InsertPart,
    descriptions.PullTest,
    plugging.PlugIn,
)
AXES = {"MaxForceAxes": [8.0, 8.0, 0.0], "MaxTorqueAxes": [1.0, 2.0, 0.0]}


@pytest.mark.parametrize(
    ("compound", "skill", "target", "count"),
    [
        (insertion.insert_into_bore, "InsertIntoBore", "Bore", 4),
        (plugging.plug_into_socket, "PlugIntoSocket", "Socket", 5),
    ],
)
def test_motions_of_a_compound_have_its_limits(compound: type, skill: str, target: str, count: int) -> None:
    seen: dict[str, dict[str, list[float]]] = {}

    def execute(motion: Any) -> State:
        seen[motion.label] = {key: list(motion.params[key].values) for key in AXES}
        return motion.success("done")

    with SkillBench(SCENE) as bench:
        for motion in MOTIONS:
            bench.stand_in(motion, execute=execute)
        bench.load(compound)
        parts = {"Part": bench.wmi.get_element(PLUG), target: bench.wmi.get_element(SOCKET)}
        task = bench.command(skill, Arm=bench.wmi.get_element("rparts:ArmDevice-3"), **parts, **AXES)
        task.tick(20)
        assert task.state is State.Success, task.why
    assert len(seen) == count, seen
    assert all(limits == AXES for limits in seen.values()), seen
