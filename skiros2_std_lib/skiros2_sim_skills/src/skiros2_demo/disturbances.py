"""What goes wrong while the robot works, on purpose: `--disturb NAME`."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Any, Protocol

from skiros2_common.core.errors import Refused
from skiros2_demo.plan_text import Step, name_of
from skiros2_demo.world_state import Thing, WorldState
from skiros2_std_reasoners.core.geometry import Pose, composed, from_euler

CONTAIN = "skiros:contain"


class Hand(Protocol):
    """What a disturbance does to the simulated world; see `Simulation`."""

    def pose_of(self, element: str) -> Pose: ...

    def put(self, element: str, pose: Pose) -> None: ...

    def slip(self, gripper: str, active: bool) -> None: ...


class Disturbance(Protocol):
    """Told how the goal goes on, it strikes once when its time has come.

    :ivar done: whether it has.
    """

    done: bool

    def steps(self, steps: Sequence[Step]) -> str:
        """The steps of the plan, with their states, are so now. Returns what it has done, in words; "" is nothing."""

    def tree(self, nodes: Sequence[Any]) -> str:
        """A task, a `SkillProgress` for each node, is so now. Likewise."""


class Moved:
    """While the robot drives to a product, somebody puts that into another tray of the same workstation.

    :param goal: the tray where the product is to come; not into that.
    :param chance: where exactly it is put.
    """

    def __init__(self, hand: Hand, world: WorldState, product: str, goal: str, chance: Random) -> None:
        self._hand = hand
        self._product = world.things[product]
        self._tray = _empty_neighbour(world, product, goal)
        self._chance = chance
        self.done = False

    def steps(self, steps: Sequence[Step]) -> str:
        if self.done or not any(name_of(step) == "drive" and step["state"] == "running" for step in steps):
            return ""
        self.done = True
        above = (self._tray.size[2] + self._product.size[2]) / 2 + 0.002
        x, y = (self._chance.uniform(-0.02, 0.02) for _ in range(2))
        place = Pose((x, y, above), from_euler(0.0, 0.0, self._chance.uniform(-0.2, 0.2)))
        self._hand.put(self._product.id, composed(self._hand.pose_of(self._tray.id), place))
        return f"somebody puts {self._product.name} into {self._tray.name}"

    def tree(self, nodes: Sequence[Any]) -> str:
        return ""


class Slip:
    """While the arm lifts for the first time, the gripper loses its grip; after the failure it holds again."""

    def __init__(self, hand: Hand, gripper: Thing) -> None:
        self._hand = hand
        self._gripper = gripper
        self._slips = False
        self.done = False

    def steps(self, steps: Sequence[Step]) -> str:
        if not self._slips or not any(step["state"] == "failed" for step in steps):
            return ""
        self._slips = False
        self._hand.slip(self._gripper.id, False)
        return f"{self._gripper.name} has its grip back"

    def tree(self, nodes: Sequence[Any]) -> str:
        if self.done or not any("lift" in node.label and node.state == node.RUNNING for node in nodes):
            return ""
        self.done = self._slips = True
        self._hand.slip(self._gripper.id, True)
        return f"{self._gripper.name} loses its grip"


def _empty_neighbour(world: WorldState, product: str, goal: str) -> Thing:
    """An empty tray on the workstation where the product is.

    :raises Refused: there is none.
    """
    trays = world.holders(product, CONTAIN)
    stations = {station for tray in trays for station in world.holders(tray, CONTAIN)}
    beside = sorted(o for s, p, o in world.relations if p == CONTAIN and s in stations and o not in (*trays, goal))
    for thing in (world.things[other] for other in beside):
        if thing.properties.get("skiros:ContainerState") == ["Empty"]:
            return thing
    raise Refused(f"there is no other empty tray on the workstation where {world.name(product)} is")
