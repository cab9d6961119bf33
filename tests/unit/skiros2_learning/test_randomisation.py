"""Draws of a scene as it might be in reality."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_learning.core.randomisation import BodySpread, Draw, Randomisation, draw, quantities
from skiros2_motion.core.geometry import Pose, to_euler
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec

HERE = Pose((1.0, 2.0, 0.5), (0.0, 0.0, 0.0, 1.0))
SCENE = SceneSpec(
    (
        BodySpec("skiros:Product-1", label="Block", pose=HERE, size=(0.1, 0.2, 0.3), movable=True, mass=2.0),
        BodySpec("skiros:Location-2", label="Table", pose=HERE, size=(1.0, 1.0, 0.5)),
    )
)


def drawn(spread: BodySpread, seed: int = 1, **other: object) -> Draw:
    return draw(SCENE, Randomisation({"Block": spread}, **other), np.random.default_rng(seed))  # type: ignore[arg-type]


def test_the_same_seed_gives_the_same_scene() -> None:
    spread = BodySpread(position=0.01, height=0.01, yaw=0.1, mass=0.1, size=0.1, friction=0.1)
    assert drawn(spread) == drawn(spread)
    assert drawn(spread) != drawn(spread, seed=2)


def test_only_what_is_named_differs() -> None:
    changed, table = drawn(BodySpread(position=0.01)).scene.bodies
    assert table == SCENE.bodies[1]
    assert changed.pose.position != HERE.position
    assert dataclasses.replace(changed, pose=HERE) == SCENE.bodies[0]


def test_distributions_are_clipped() -> None:
    for seed in range(200):
        (x, y, _), turn = drawn(BodySpread(position=0.01, yaw=0.1, clip=1.0), seed).scene.bodies[0].pose
        assert abs(x - 1.0) <= 0.0100001
        assert abs(y - 2.0) <= 0.0100001
        assert abs(to_euler(turn)[2]) <= 0.1000001


def test_a_body_of_another_size_stands_on_the_same_ground() -> None:
    body = drawn(BodySpread(size=0.1)).scene.bodies[0]
    assert body.size is not None
    assert body.size != (0.1, 0.2, 0.3)
    assert body.pose.position[2] - body.size[2] / 2 == pytest.approx(0.5 - 0.15)


def test_mass_friction_and_start() -> None:
    found = drawn(BodySpread(mass=0.1, friction=0.05, mean_friction=0.5), starts=("left", "right"))
    assert found.scene.bodies[0].mass != 2.0
    assert math.isclose(found.friction["skiros:Product-1"], 0.5, abs_tol=0.1)
    assert found.start in ("left", "right")


def test_friction_and_mass_are_drawn_around_the_values_of_the_scene() -> None:
    block = dataclasses.replace(SCENE.bodies[0], friction=0.35, mass=None, size=(0.01, 0.01, 0.01))
    scene = SceneSpec((block,))
    spread = Randomisation({"Block": BodySpread(friction=0.02, mass=0.1)})
    draws = [draw(scene, spread, np.random.default_rng(seed)) for seed in range(200)]
    assert np.mean([each.friction[block.id] for each in draws]) == pytest.approx(0.35, abs=0.01)
    assert np.mean([each.scene.bodies[0].mass for each in draws]) == pytest.approx(0.05, rel=0.05)  # the simulator's
    found = {each.name: (each.centre, each.spread) for each in quantities(scene, spread)}
    assert found == {
        "Block: friction": ("0.35", "standard deviation 0.02, at most 2 times that"),
        "Block: mass": ("0.05 kg", "standard deviation 0.005 kg, at most 2 times that"),
    }


def test_a_friction_of_the_scenario_is_named_beside_that_of_the_scene() -> None:
    block = dataclasses.replace(SCENE.bodies[0], friction=0.35)
    (found,) = quantities(SceneSpec((block,)), Randomisation({"Block": BodySpread(mean_friction=0.8)}))
    assert (found.centre, found.spread) == ("0.8", "the scenario's, instead of 0.35 of the scene")


def test_an_unknown_body_is_reported() -> None:
    with pytest.raises(UnknownName, match="no body is labelled 'Blok'; near: Block"):
        draw(SCENE, Randomisation({"Blok": BodySpread()}), np.random.default_rng(0))
