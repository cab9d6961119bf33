"""Runs the connector demo: one goal, a plan for two arms, its execution, and the check of the result."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import rospy

from skiros2_bags.core.run import Finding
from skiros2_common.command_line.command import Parser
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.core.part_poses import depth_and_tilt
from skiros2_demo.demo import Demo, add_options, run_demo
from skiros2_demo.run_check import Thing
from skiros2_demo.simulation import Simulation, simulated_launch
from skiros2_motion.core.geometry import IDENTITY, Pose, composed
from skiros2_piston_demo.disturbances import WhileRunning
from skiros2_piston_demo.force_log import ForceLog
from skiros2_std_reasoners.core import spatial_data as space

#: Maximum error of the housing's place on its stand (m).
_FAR = 0.0015
#: The motions in contact, whose forces are recorded.
_IN_CONTACT = {"move_until_contact", "spiral_search", "plug_in", "pull_test"}
#: Distance by which a plug slips in the fingers (m): the click comes too early for the hand.
_SLIP = 0.006
#: Limit of the force (N), exceeded by a fifth at most.
_LIMIT, _OVERSHOOT = 40.0, 1.2
#: A pull (N) that takes out a plug that is not latched, and does not lift the housing; its duration (s).
_PULL, _PULL_TIME = (0.0, 0.0, 2.0), 0.5
_DISTURB = (
    "what goes wrong: the plug slips in the fingers before it is plugged in, does not click where it should, and is "
    "gripped again (slip, which is the default; none for no disturbance)"
)
_DISTURBED = ["slip"]
#: Tolerance of the depth of a latched plug (m).
_NEAR = 0.001


class ConnectorDemo(Demo):
    """One run of the demo."""

    robot = "/connector_cell"
    # from behind the stands: the arms would hide the plug
    view = (-0.12, 0.5, 0.42)
    next = {
        "make demo DEMO=connector DEMO_ARGS='--disturb none --seed 3'": "the housing is misplaced, and nothing slips",
        "make demo DEMO=piston": "a piston with a tight fit, and a ring that guards its bore",
        "make demo DEMO=connector GUI=1": "with the window of the simulator",
    }
    _forces: ForceLog

    def launch_arguments(self) -> list[str]:
        return simulated_launch(self._options, "skiros2_connector_demo", "connector.launch")

    def prepare(self, simulation: Simulation, scene: list[Element], product: Thing, tray: Thing) -> None:
        things = {element.id: element for element in scene}
        (self._housing,) = self._world.holders(tray.id, "skiros:hasA")
        self._rim = space.pose_of(things[tray.id]) or IDENTITY
        if self._options.seed:
            at = simulation.pose_of(self._housing)
            simulation.put(self._housing, composed(at, _error(Random(self._options.seed))))
        place = simulation.pose_of(self._world.labelled("Work place").id)
        (top,) = (space.pose_of(e) or IDENTITY for e in scene if e.label == "Top of the work place")
        (grasp,) = (space.pose_of(e) or IDENTITY for e in scene if e.label == "Grip of the plug")
        rim = composed(place, top).position[2] + self._world.things[self._housing].size[2]
        length = grasp.position[2] + product.size[2] / 2.0
        self._forces = ForceLog(f"{self.robot}/right_arm/right_compliant/state", rim, length)
        if "slip" in self._options.disturb:
            self.add_disturbance(WhileRunning(("plug_into_socket",), lambda: _slipped(simulation, product)))
        self.prepare_pictures(simulation, scene)

    def watch(self, nodes: Sequence[Any]) -> None:
        running = {node.label for node in nodes if node.state == node.RUNNING}
        self._forces.record("plug_into_socket" in running and bool(running & _IN_CONTACT))
        if "pull_test" in running:
            self.take_pictures("during")

    def check_truth(self, simulation: Simulation, product: Thing, tray: Thing) -> list[Finding]:
        latch, deepest = (float(tray.properties[key][0]) for key in ("skiros:LatchDepth", "skiros:Depth"))
        simulation.push(product.id, _PULL, _PULL_TIME)
        rospy.sleep(2.0 * _PULL_TIME)
        rim = composed(simulation.pose_of(self._housing), self._rim)
        depth, tilt = depth_and_tilt(rim, simulation.pose_of(product.id), product.size[2])
        self._forces.close()
        most = self._forces.max_force
        plot = self._forces.save(Path(self._options.folder) / "force_over_depth.png", _LIMIT)
        return [
            Finding(
                latch - _NEAR < depth < deepest + _NEAR,
                f"{product.name} is {1000 * depth:.1f} mm deep in {tray.name}, after a pull: it is latched",
            ),
            Finding(tilt < math.radians(3.0), f"it is tilted by {math.degrees(tilt):.2f} degrees"),
            Finding(most < _LIMIT * _OVERSHOOT, f"the largest force at the wrist was {most:.1f} N"),
            Finding(plot.exists(), f"plot: {plot}"),
        ]


def _error(random: Random) -> Pose:
    """Returns an error of the housing's place, in its own frame."""
    far, direction = random.uniform(0.0, _FAR), random.uniform(0.0, 2.0 * math.pi)
    return Pose((far * math.cos(direction), far * math.sin(direction), 0.0), IDENTITY.orientation)


def _slipped(simulation: Simulation, plug: Thing) -> str:
    """The plug is pulled out of the fingers by some millimetres."""
    (x, y, z), orientation = simulation.pose_of(plug.id)
    simulation.put(plug.id, Pose((x, y, z - _SLIP), orientation))
    return f"somebody pulls {plug.name} {1000 * _SLIP:g} mm out of the fingers"


def main(arguments: list[str]) -> int:
    """Runs the program. Returns the exit status: 0 goal reached, 1 not reached, 2 wrong arguments, 128 + n after
    signal n."""
    options = _parser().parse_args(arguments)
    options.disturb = [name for name in options.disturb or _DISTURBED if name != "none"]
    return run_demo(ConnectorDemo(options, sys.stdout), "connector_demo")


def _parser() -> Any:
    parser = Parser(prog="connector_demo", description=__doc__)
    parser.add_argument("--product", default="Power plug", help="label of the plug (%(default)s)")
    parser.add_argument("--tray", default="Power socket", metavar="SOCKET", help="label of the socket (%(default)s)")
    parser.add_argument("--disturb", choices=("slip", "none"), action="append", help=_DISTURB)
    add_options(parser, rate=1.0, timeout=600.0)
    return parser
