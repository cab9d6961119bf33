"""A cell to simulate, written by hand: a mobile manipulator, two workstations with two trays each, three products."""

from __future__ import annotations

import dataclasses

from skiros2_motion.core.geometry import IDENTITY, Pose, Vector
from skiros2_sim.core.scene_spec import ArmSpec, BaseSpec, BodySpec, GripperSpec, RobotSpec, SceneSpec

ROBOT, BASE, ARM, GRIPPER = "cora:Robot-1", "rparts:RoboticBase-2", "rparts:ArmDevice-3", "rparts:GripperEffector-4"
TABLE_1, TABLE_2 = "demo:Workstation-6", "demo:Workstation-7"
TRAYS = ("demo:Tray-10", "demo:Tray-11", "demo:Tray-12", "demo:Tray-13")
PRODUCTS = ("skiros:Product-14", "skiros:Product-15", "skiros:Product-16")
#: m, of the tables; of the trays on them; the edge of a product.
TABLE_TOP, TRAY_TOP, EDGE = 0.5, 0.52, 0.05
PANDA = "franka_panda/panda.urdf"


def at(x: float, y: float, z: float) -> Pose:
    return Pose((x, y, z), IDENTITY.orientation)


def box(eid: str, pose: Pose, size: Vector, movable: bool = False) -> BodySpec:
    """A box; one that moves weighs 0.2 kg."""
    kind = eid.rpartition("-")[0]
    return BodySpec(eid, kind, eid, pose=pose, size=size, movable=movable, mass=0.2 if movable else None)


def product(eid: str, pose: Pose) -> BodySpec:
    return box(eid, pose, (EDGE,) * 3, movable=True)


def mobile_manipulator() -> RobotSpec:
    """A Panda on a Husky."""
    arm = ArmSpec(ARM, "arm", PANDA, at(0.3, 0.0, 0.39), GripperSpec(GRIPPER, "gripper"))
    return RobotSpec(ROBOT, "mobile_manipulator", base=BaseSpec(BASE, "base", "husky/husky.urdf"), arms=(arm,))


def fixed_panda() -> RobotSpec:
    """A Panda that stands on a block of 0.3 m in the map's origin."""
    arm = ArmSpec(ARM, "arm", PANDA, at(0.0, 0.0, 0.3), GripperSpec(GRIPPER, "gripper"))
    return RobotSpec(ROBOT, "stationary", arms=(arm,))


def cell() -> SceneSpec:
    """All of it; the robot looks along x, to between the tables."""
    bodies = []
    for table, y in ((TABLE_1, 1.5), (TABLE_2, -1.5)):
        bodies.append(box(table, at(2.0, y, TABLE_TOP / 2), (0.8, 1.2, TABLE_TOP)))
    for tray, y in zip(TRAYS, (1.75, 1.25, -1.25, -1.75), strict=True):
        bodies.append(box(tray, at(1.85, y, (TABLE_TOP + TRAY_TOP) / 2), (0.25, 0.3, TRAY_TOP - TABLE_TOP)))
    for eid, y in zip(PRODUCTS, (1.75, 1.25, -1.75), strict=True):
        bodies.append(product(eid, at(1.85, y, TRAY_TOP + EDGE / 2)))
    return SceneSpec(tuple(bodies), (mobile_manipulator(),))


def bench() -> SceneSpec:
    """A product on a tray on a table, before a Panda."""
    return SceneSpec(
        (
            box(TABLE_1, at(0.55, 0.0, 0.2), (0.4, 0.8, 0.4)),
            box(TRAYS[0], at(0.5, 0.0, 0.41), (0.25, 0.3, 0.02)),
            product(PRODUCTS[0], at(0.5, 0.05, 0.42 + EDGE / 2)),
        ),
        (fixed_panda(),),
    )


def with_body(scene: SceneSpec, *bodies: BodySpec) -> SceneSpec:
    """The scene with more in it."""
    return dataclasses.replace(scene, bodies=(*scene.bodies, *bodies))
