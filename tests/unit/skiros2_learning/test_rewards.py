"""The catalogue of rewards, on a recorded execution with known values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_learning.core import rewards
from skiros2_learning.core.episode_record import EpisodeRecord
from skiros2_skill.testing import SkillBench

TIMES = np.array([0.0, 1.0, 3.0])


@pytest.fixture
def record() -> EpisodeRecord:
    """A block moves 0.3 m along x, then 0.4 m along y, to 0.1 m from its goal; the arm presses with up to 5 N."""
    block = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.4, 0.0]])
    goal = np.tile([0.3, 0.5, 0.0], (3, 1))
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    return EpisodeRecord(
        True, "", 3.0, TIMES, {"Block": block, "Goal": goal}, {"Block": turn, "Goal": turn},
        {"Arm.force": np.array([0.0, 5.0, 1.0]), "Arm.measured_torque": np.array([0.1, 0.2, 0.0]),
         "Arm.power": np.array([0.0, 10.0, 2.0])},
        {("Block", "Wall"): np.array([0.4, 0.02, 0.3]), ("Block", "Post"): np.array([0.5, 0.5, 0.5])},
    )  # fmt: skip


def test_goal_distance_falls_like_a_bell(record: EpisodeRecord) -> None:
    assert rewards.GoalDistance("Block", "Goal", width=0.1)(record) == pytest.approx(math.exp(-0.5))
    assert rewards.Distance("Block", "Goal")(record) == pytest.approx(0.1)


def test_success_and_time(record: EpisodeRecord) -> None:
    assert rewards.Success()(record) == 1.0
    assert rewards.Time()(record) == 3.0


def test_forces_by_contact_and_by_the_sensor(record: EpisodeRecord) -> None:
    assert rewards.AppliedForce("Arm")(record) == 5.0
    assert rewards.AppliedForce("Arm", statistic="mean")(record) == pytest.approx((2.5 * 1 + 3.0 * 2) / 3)
    assert rewards.MeasuredForce("Arm", quantity="torque", statistic="final")(record) == 0.0


def test_the_nearest_obstacle_counts(record: EpisodeRecord) -> None:
    reward = rewards.ObstacleDistance("Block", ("Wall", "Post"), limit=0.1)
    assert reward(record) == pytest.approx(0.02)
    assert rewards.ObstacleDistance("Block", ("Post",), limit=0.1)(record) == pytest.approx(0.1)


def test_path_length_and_energy(record: EpisodeRecord) -> None:
    assert rewards.PathLength("Block")(record) == pytest.approx(0.7)
    assert rewards.Energy("Arm")(record) == pytest.approx(10.0 * 1 + 2.0 * 2)


def test_statistics_of_any_series(record: EpisodeRecord) -> None:
    values = {name: rewards.Signal("Arm.force", name)(record) for name in rewards.STATISTICS}
    assert values == pytest.approx({"final": 1.0, "maximum": 5.0, "minimum": 0.0, "mean": 8.5 / 3, "integral": 8.5})


def test_what_was_not_recorded_is_reported_with_near_names(record: EpisodeRecord) -> None:
    with pytest.raises(UnknownName, match=r"no thing 'Blok' was recorded; near: Block"):
        rewards.Distance("Blok", "Goal")(record)
    with pytest.raises(UnknownName, match=r"no series 'Arm.forse' was recorded; near: Arm.force"):
        rewards.Signal("Arm.forse")(record)


def test_conditions_of_the_world_model(record: EpisodeRecord, skill_bench: SkillBench) -> None:
    box = skill_bench.add("skiros:Container", "Box", ContainerState="Full")
    skill_bench.add("skiros:Product", "Part", box)
    record.wmi = skill_bench.wmi
    assert rewards.Relation("Box", "skiros:contain", "Part")(record) == 1.0
    assert rewards.Relation("Part", "skiros:contain", "Box")(record) == 0.0
    assert rewards.PropertyValue("Box", "skiros:ContainerState", "Full")(record) == 1.0
    assert rewards.PropertyValue("Box", "skiros:ContainerState", "Empty")(record) == 0.0
    query = 'SELECT ?x WHERE { ?x rdfs:label "%s" }'
    assert rewards.Sparql(query % "Part")(record) == 1.0
    assert rewards.Sparql(query % "Lid")(record) == 0.0
    with pytest.raises(UnknownName, match="no element is labelled 'Lid'"):
        rewards.Relation("Lid", "skiros:contain", "Part")(record)


def test_a_name_of_the_catalogue_cannot_be_taken_twice() -> None:
    with pytest.raises(WrongValue, match="reward 'success' is"):

        @rewards.reward("success")
        class Other:
            def __call__(self, record: EpisodeRecord) -> float:
                return 0.0
