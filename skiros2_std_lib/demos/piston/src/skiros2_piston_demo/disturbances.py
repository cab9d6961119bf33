"""Disturbances of the demo of the piston cell. Each occurs once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from skiros2_demo.run_check import Step, Thing
from skiros2_demo.simulation import Simulation
from skiros2_motion.core.geometry import Pose

#: Distance by which the block is pushed (m).
_PUSH = 0.0015
#: Force on the hand (N), and its duration (s): well above the limit of the skills. Upwards, it does not tear the piston
#: out of the fingers.
_HIT, _HIT_TIME = (0.0, 0.0, 90.0), 0.15


class WhileRunning:
    """Acts when a node with one of some labels runs.

    :param labels: of nodes.
    :param act: what happens; returns its description.
    :param needs_plan: whether the goal is only reached with another plan.
    """

    def __init__(self, labels: Sequence[str], act: Callable[[], str], needs_plan: bool = True) -> None:
        self._labels, self._act = labels, act
        self.done, self.needs_plan = False, needs_plan

    def steps(self, steps: Sequence[Step]) -> str:
        return ""

    def tree(self, nodes: Sequence[Any]) -> str:
        if self.done or not any(node.label in self._labels and node.state == node.RUNNING for node in nodes):
            return ""
        self.done = True
        return self._act()


def pushed_block(simulation: Simulation, block: Thing) -> WhileRunning:
    """The block is moved while the piston is on it or above it: the search finds the bore nevertheless."""

    def act() -> str:
        (x, y, z), orientation = simulation.pose_of(block.id)
        simulation.put(block.id, Pose((x + _PUSH, y - _PUSH, z), orientation))
        return f"somebody pushes {block.name} by {1000 * _PUSH:g} mm along x and y"

    return WhileRunning(("move_until_contact", "spiral_search"), act, needs_plan=False)


def hit_arm(simulation: Simulation, gripper: Thing) -> WhileRunning:
    """Somebody hits the hand with the piston: more than the force limit, which ends the goal."""

    def act() -> str:
        simulation.push(gripper.id, _HIT, _HIT_TIME)
        return f"somebody hits {gripper.name} with {max(_HIT):g} N"

    return WhileRunning(("insert_part", "spiral_search"), act, needs_plan=False)


def preemption(preempt: Callable[[], None]) -> WhileRunning:
    """Somebody preempts all tasks while the piston is inserted."""

    def act() -> str:
        preempt()
        return "somebody preempts the robot's tasks"

    return WhileRunning(("insert_part", "spiral_search"), act)
