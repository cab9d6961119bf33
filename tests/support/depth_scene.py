"""An engine block on a table and a depth camera, in the simulated world: views with known errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skiros2_motion.core.bore import Bore
from skiros2_motion.core.geometry import Pose, Vector, from_euler
from skiros2_perception.core.shape import Shape, box_shape
from skiros2_perception.core.transforms import moved
from skiros2_perception.core.view import Sensor, View
from skiros2_sim.core.camera import Lens, looking_at, picture_from
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.world import World
from support.simulated_cell import at

TABLE, BLOCK, PART = "demo:Workstation-1", "skiros:Product-2", "skiros:Product-3"
#: m; the top of the table.
TOP = 0.4
SIZE: Vector = (0.36, 0.12, 0.1)
BORES = tuple(Bore(x, 0.0, 0.0502, 0.08, 0.002) for x in (-0.12, -0.04, 0.04, 0.12))
EXPECTED = at(0.5, 0.0, TOP + SIZE[2] / 2)
#: Positions of the camera, on three sides of the block; it looks at the block's expected position.
EYES = ((0.15, -0.25, 0.85), (0.85, -0.3, 0.8), (0.5, 0.35, 0.85))
LENS = Lens()
SENSOR = Sensor()


def scene(*bodies: BodySpec) -> SceneSpec:
    """A table with a block that has four bores, and more bodies."""
    return table(BodySpec(BLOCK, "skiros:Product", pose=EXPECTED, size=SIZE, bores=BORES), *bodies)


def table(*bodies: BodySpec) -> SceneSpec:
    """A table with bodies."""
    return SceneSpec((BodySpec(TABLE, "demo:Workstation", pose=at(0.5, 0.0, TOP / 2), size=(0.8, 1.0, TOP)), *bodies))


def block_shape() -> Shape:
    return box_shape(SIZE, BORES)


def displaced(random: np.random.Generator, shift: float = 0.03, turn: float = math.radians(10)) -> Pose:
    """The expected pose, shifted on the table by up to `shift` (m) and turned by up to `turn` (rad)."""
    angle, distance = random.uniform(0, 2 * math.pi), shift * math.sqrt(random.uniform())
    x, y, z = EXPECTED.position
    yaw = float(random.uniform(-turn, turn))
    return Pose((x + distance * math.cos(angle), y + distance * math.sin(angle), z), from_euler(0.0, 0.0, yaw))


def take(
    world: World,
    eye: Sequence[float],
    random: np.random.Generator | None = None,
    sensor: Sensor = SENSOR,
    target: Sequence[float] = (0.5, 0.0, TOP + 0.02),
) -> View:
    """A view with the errors of a sensor: of each pixel's depth, and of the camera's pose; exact without `random`."""
    picture = picture_from(world, looking_at(eye, target), LENS)
    f, _, cx, _, _, cy, *_ = LENS.matrix
    depth, pose = picture.depth.astype(float), picture.pose
    if random is not None:
        depth = depth + random.normal(0.0, sensor.noise, depth.shape)
        error = random.normal(0.0, 1.0, 6) * np.repeat((sensor.position, sensor.angle), 3)
        pose = moved(pose, error)
    return View(depth, (f, f), (cx, cy), pose, "map", world.time, picture.rgb)
