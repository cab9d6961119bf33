"""A learned push on real nodes in the simulator: applied, run without values, proven from the bag and the simulator."""

from __future__ import annotations

import datetime
import math
import subprocess
from pathlib import Path

import rospy

from skiros2_bags.core.run import Finding, Run
from skiros2_common.core.errors import Refused, TimedOut
from skiros2_common.core.world_element import Element
from skiros2_demo.demo import System
from skiros2_demo.simulation import Simulation
from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.parameter_sets import apply_result
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.validation import Sample
from skiros2_msgs.srv import ResourceGetDescriptions
from skiros2_runs.core.states import NodeState
from skiros2_skill.core.engine.learned_parameters import VALUE
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

_ROBOT = "/pusher"
#: Times real time.
_RATE = 2.0
#: Timeout of the push (s of wall time).
_TIMEOUT = 180.0


def produce(
    scenario: Scenario, number: int, result: Evaluation, study: Path, folder: Path, validated: Sample | None = None
) -> list[Finding]:
    """Starts a system of its own, applies a configuration of the push, and runs the skill without values for it.

    :param number: of the evaluation with the result.
    :param study, folder: of the study; for bag and logs.
    :param validated: the repetitions of its validation.
    :raises SkirosError: a part of the system fails, or the skill does.
    """
    with System(folder) as system:
        system.start_recording(_ROBOT)
        system.init_node("learning")
        system.launch("skiros2_learning_demo", "push.launch", "gui:=false", f"rate:={_RATE}")
        simulation = Simulation()
        system.wait_for(simulation.is_ready, "the simulator")
        skills = rospy.ServiceProxy(f"{_ROBOT}/get_skills", ResourceGetDescriptions)
        system.wait_for(lambda: _is_offered(skills), f"the skill manager {_ROBOT}")
        skills()  # returns when all skills are loaded
        system.wait_for_recorder(_ROBOT, f"{_ROBOT}/monitor")
        wmi = WorldModelInterface(rospy.get_name())
        date = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        (applied,) = apply_result(wmi, scenario, number, result, date, str(study), validated)
        block, goal = (wmi.resolve_elements(Element("", label))[0] for label in ("Block", "Goal"))
        before = simulation.pose_of(block.id).position
        command = ["rosrun", "skiros2_skill", "run", "Push", "Object=Block", "Goal=Goal"]
        try:
            ended = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
        except subprocess.TimeoutExpired:
            raise TimedOut(f"the push has not ended within {_TIMEOUT:g} s; logs in {folder}") from None
        after, target = simulation.pose_of(block.id).position, pose_in_scene(wmi, goal)[1].position
        system.stop_recording()
    if ended.returncode:
        text = " ".join((ended.stderr or ended.stdout).split())
        raise Refused(f"the push has failed: {text}; logs in {folder}")
    limit = scenario.success[0].at_most
    off = math.dist(after, target)
    start = math.dist(before, target)
    text = f"in the simulator the block is {off * 1e3:.0f} mm from the goal, {limit * 1e3:.0f} mm are allowed; it was"
    findings = [
        Finding(True, f"the skill used the values of {applied.id} and succeeded"),
        Finding(off <= limit < start, f"{text} {start * 1e3:.0f} mm away"),
    ]
    return findings + _proof(Run.open(system.bag), result)


def _proof(run: Run, result: Evaluation) -> list[Finding]:
    pushes = [skill for skill in run.skills() if skill.type == "skiros:Push"]
    states = [NodeState(skill.state) for skill in pushes]
    ended = f"ended with {', '.join(state.name.lower() for state in states)}" if states else "did not run"
    scene = run.world()
    elements = [element for node in scene if (element := scene.element(node.id)) is not None]
    values = {each.label: each.value_of(VALUE) for each in elements if each.type == "skiros:Parameter"}
    wanted = {name.rpartition(".")[2]: value for name, value in result.configuration.items()}
    same = all(
        values.get(key) is not None and math.isclose(float(values[key]), float(value), rel_tol=1e-6)
        for key, value in wanted.items()
    )
    return [
        Finding(states == [NodeState.SUCCESS], f"in the bag, Push {ended}"),
        Finding(same, "in the bag, the world model has the learned values"),
    ]


def _is_offered(service: rospy.ServiceProxy) -> bool:
    try:
        service.wait_for_service(0.01)
    except rospy.ROSException:
        return False
    return True
