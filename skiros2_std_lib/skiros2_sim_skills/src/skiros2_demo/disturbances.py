"""Disturbances of the demo: `--disturb NAME`."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Any, Protocol

from skiros2_common.core.errors import Refused
from skiros2_demo.plan_text import Step, name_of
from skiros2_demo.world_state import Thing, WorldState
from skiros2_std_reasoners.core.geometry import Pose, composed, from_euler

CONTAIN = "skiros:contain"


class WorldControl(Protocol):
    """The part of `Simulation` that disturbances use."""

    def pose_of(self, element: str) -> Pose: ...

    def put(self, element: str, pose: Pose) -> None: ...

    def slip(self, gripper: str, active: bool) -> None: ...


class Disturbance(Protocol):
    """A disturbance that occurs once, when the execution reaches a certain state.

    :ivar done: whether it has occurred.
    """

    done: bool

    def steps(self, steps: Sequence[Step]) -> str:
        """Called when the steps of the plan or their states change. Returns a description of what it did; "" for
        nothing."""

    def tree(self, nodes: Sequence[Any]) -> str:
        """Called when a task changes, with a `SkillProgress` per node. Returns the same as `steps`."""


class Moved:
    """Moves a product to another tray of the same workstation while the robot drives there.

    :param goal: the target tray of the product, which is not used.
    :param random: for the exact pose.
    """

    def __init__(self, control: WorldControl, world: WorldState, product: str, goal: str, random: Random) -> None:
        self._control = control
        self._product = world.things[product]
        self._tray = _empty_neighbour(world, product, goal)
        self._random = random
        self.done = False

    def steps(self, steps: Sequence[Step]) -> str:
        if self.done or not any(name_of(step) == "drive" and step["state"] == "running" for step in steps):
            return ""
        self.done = True
        above = (self._tray.size[2] + self._product.size[2]) / 2 + 0.002
        x, y = (self._random.uniform(-0.02, 0.02) for _ in range(2))
        place = Pose((x, y, above), from_euler(0.0, 0.0, self._random.uniform(-0.2, 0.2)))
        self._control.put(self._product.id, composed(self._control.pose_of(self._tray.id), place))
        return f"somebody puts {self._product.name} into {self._tray.name}"

    def tree(self, nodes: Sequence[Any]) -> str:
        return ""


class Slip:
    """Makes the gripper slip in the first lift; its friction is restored after the failure."""

    def __init__(self, control: WorldControl, gripper: Thing) -> None:
        self._control = control
        self._gripper = gripper
        self._slips = False
        self.done = False

    def steps(self, steps: Sequence[Step]) -> str:
        if not self._slips or not any(step["state"] == "failed" for step in steps):
            return ""
        self._slips = False
        self._control.slip(self._gripper.id, False)
        return f"{self._gripper.name} has its grip back"

    def tree(self, nodes: Sequence[Any]) -> str:
        if self.done or not any("lift" in node.label and node.state == node.RUNNING for node in nodes):
            return ""
        self.done = self._slips = True
        self._control.slip(self._gripper.id, True)
        return f"{self._gripper.name} loses its grip"


def _empty_neighbour(world: WorldState, product: str, goal: str) -> Thing:
    """Returns an empty tray on the workstation of a product.

    :raises Refused: there is none.
    """
    trays = world.holders(product, CONTAIN)
    stations = {station for tray in trays for station in world.holders(tray, CONTAIN)}
    neighbours = sorted(o for s, p, o in world.relations if p == CONTAIN and s in stations and o not in (*trays, goal))
    for thing in (world.things[other] for other in neighbours):
        if thing.properties.get("skiros:ContainerState") == ["Empty"]:
            return thing
    raise Refused(f"there is no other empty tray on the workstation where {world.name(product)} is")
