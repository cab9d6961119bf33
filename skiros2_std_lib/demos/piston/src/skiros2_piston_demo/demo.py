"""Runs the piston demo: one goal, a plan for two arms, its execution, and the check of the result."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import rospy

from skiros2_bags.core.run import Finding
from skiros2_common.command_line.command import Parser
from skiros2_common.core.explanation import Explanation, worst_kind
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.assembly import LOCATED
from skiros2_contact_skills.core.part_poses import depth_and_tilt
from skiros2_demo.demo import Demo, add_options, run_demo
from skiros2_demo.run_check import Thing
from skiros2_demo.simulation import Simulation, Slip, simulated_launch
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, from_euler
from skiros2_msgs.msg import AchieveResult
from skiros2_msgs.srv import SkillCommand, SkillCommandRequest
from skiros2_piston_demo.disturbances import hit_arm, preemption, pushed_block
from skiros2_piston_demo.force_log import ForceLog
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

DISTURBANCES = ("push", "slip", "preempt", "force")
_DISTURB = (
    "what goes wrong: the block is pushed (push), the ring slips in its gripper (slip), somebody preempts the tasks "
    "while the piston is held (preempt), or hits the hand during the insertion, which exceeds the force limit and ends "
    "the goal until a person sends it again (force); "
    "may be given twice (push; none for no disturbance)"
)
#: Maximum error of the block's place (m, rad).
_FAR, _TURN = 0.003, math.radians(2.0)
#: Limit of the force (N), exceeded by a fifth at most.
_LIMIT, _OVERSHOOT = 40.0, 1.2
#: The motions of an insertion in contact: their forces are recorded, those of a retraction are not.
_IN_CONTACT = {"move_until_contact", "spiral_search", "insert_part"}
#: The run without options: an error of the block's place at which the search is seen, and a disturbance.
_SEED, _DISTURBED = 2, ["push"]
#: Of the result: depth (m) and tilt (rad).
_DEPTH, _TILT = 0.0015, math.radians(1.0)


class PistonDemo(Demo):
    """One run of the demo."""

    robot = "/piston_cell"
    # from behind the stands: the arms would hide the piston
    view = (-0.12, 0.5, 0.42)
    _forces: ForceLog | None = None
    _was_sent_again = False

    def launch_arguments(self) -> list[str]:
        return simulated_launch(self._options, "skiros2_piston_demo", "piston.launch")

    def prepare(self, simulation: Simulation, scene: list[Element], product: Thing, tray: Thing) -> None:
        things = {element.id: element for element in scene}
        (block,) = (things[self._world.holders(tray.id, "skiros:hasA")[0]],)
        self._rim = space.pose_of(things[tray.id]) or IDENTITY
        self._block = self._world.things[block.id]
        at = simulation.pose_of(block.id)
        if self._options.seed:
            simulation.put(block.id, composed(at, _error(Random(self._options.seed))))
        if self._options.look:
            block.setProperty(LOCATED, False)
            WorldModelInterface(rospy.get_name()).update_element_properties(block)
        arm = "right_arm"
        (grasp,) = (element for element in scene if element.label == "Knob of the piston")
        length = (space.pose_of(grasp) or IDENTITY).position[2] + product.size[2] / 2.0
        height = composed(at, self._rim).position[2]
        self._forces = ForceLog(f"{self.robot}/{arm}/right_compliant/state", height, length)
        gripper = self._world.labelled("Right gripper")
        if "push" in self._options.disturb:
            self.add_disturbance(pushed_block(simulation, self._block))
        if "slip" in self._options.disturb:
            self.add_disturbance(Slip(simulation, self._world.labelled("Left gripper"), during="spiral_search"))
        if "force" in self._options.disturb:
            self.add_disturbance(hit_arm(simulation, gripper))
        if "preempt" in self._options.disturb:
            self.add_disturbance(preemption(self._preempt))
        self.prepare_pictures(simulation, scene)

    def watch(self, nodes: Sequence[Any]) -> None:
        running = {node.label for node in nodes if node.state == node.RUNNING}
        if self._forces is not None and any(node.label == "insert_into_bore" for node in nodes):
            self._forces.record("insert_into_bore" in running and bool(running & _IN_CONTACT))
        if "insert_part" in running:
            self.take_pictures("during")

    def continues(self, result: AchieveResult) -> str:
        why = map(Explanation.from_dict, json.loads(result.explanations or "[]"))
        if self._was_sent_again or "force" not in self._options.disturb or worst_kind(why) is not FailureKind.LIMIT:
            return ""
        self._was_sent_again = True
        return "a person looks at the arm and sends the goal again"

    def check_truth(self, simulation: Simulation, product: Thing, tray: Thing) -> list[Finding]:
        rim = composed(simulation.pose_of(self._block.id), self._rim)
        depth, tilt = depth_and_tilt(rim, simulation.pose_of(product.id), product.size[2])
        wanted = float(tray.properties["skiros:Depth"][0])
        found = [
            Finding(abs(depth - wanted) < _DEPTH, f"{product.name} is {1000 * depth:.1f} mm deep in {tray.name}"),
            Finding(tilt < _TILT, f"it is tilted by {math.degrees(tilt):.2f} degrees"),
        ]
        if self._forces is not None:
            self._forces.close()
            most = self._forces.max_force
            hit = "force" in self._options.disturb
            if hit:
                found.append(Finding(self._was_sent_again, "the goal ended at the limit until a person sent it again"))
            found.append(Finding(hit or most < _LIMIT * _OVERSHOOT, f"the largest force at the wrist was {most:.1f} N"))
            plot = self._forces.save(Path(self._options.folder) / "force_over_depth.png", _LIMIT)
            found.append(Finding(plot.exists(), f"plot: {plot}"))
        return found

    def _preempt(self) -> None:
        command = rospy.ServiceProxy(f"{self.robot}/command", SkillCommand)
        command(SkillCommandRequest(author="somebody", action=SkillCommandRequest.PREEMPT, execution_id=-1))


def _error(random: Random) -> Pose:
    """Returns an error of the block's place, in its own frame."""
    far, direction = random.uniform(0.0, _FAR), random.uniform(0.0, 2.0 * math.pi)
    turn = random.uniform(-_TURN, _TURN)
    return Pose((far * math.cos(direction), far * math.sin(direction), 0.0), from_euler(0.0, 0.0, turn))


def main(arguments: list[str]) -> int:
    """Runs the program. Returns the exit status: 0 goal reached, 1 not reached, 2 wrong arguments, 128 + n after
    signal n."""
    options = _parser().parse_args(arguments)
    options.disturb = [name for name in options.disturb or _DISTURBED if name != "none"]
    return run_demo(PistonDemo(options, sys.stdout), "piston_demo")


def _parser() -> Any:
    parser = Parser(prog="piston_demo", description=__doc__)
    parser.add_argument("--product", default="Piston", help="label of the piston (%(default)s)")
    parser.add_argument("--tray", default="Bore 2", metavar="BORE", help="label of the bore (%(default)s)")
    parser.add_argument("--look", action="store_true", help="the block is located with the camera first")
    parser.add_argument("--disturb", choices=(*DISTURBANCES, "none"), action="append", help=_DISTURB)
    add_options(parser, rate=1.0, timeout=600.0)
    parser.set_defaults(seed=_SEED)
    return parser
