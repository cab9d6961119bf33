"""A separate ROS master with the nodes of a replay."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.recorded_world import scene_operations
from skiros2_bags.testing.recording import Recording
from skiros2_common.core.manager_names import SKILL_MGR, matching_name
from skiros2_common.ros.private_system import PrivateSystem
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.ros.wire import operation2msg


class ReplaySystem(PrivateSystem):
    """A context manager that starts the master; this process is one of its nodes. One per process."""

    def __init__(self) -> None:
        super().__init__("replay", has_own_home=True)

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Sets parameters by full name."""
        for name, value in values.items():
            rospy.set_param(name, value)

    def node(self, package: str, program: str, name: str, parameters: Mapping[str, Any] | None = None) -> None:
        """Starts a node; does not wait for it.

        :param name: full name.
        :param parameters: private parameters.
        """
        namespace, _, own = name.rpartition("/")
        self.set_parameters({f"{name}/{key}": value for key, value in (parameters or {}).items()})
        self.start(name, ["rosrun", package, program, f"__name:={own}", f"__ns:={namespace or '/'}"])


#: Timeout for the start of a node (s).
READY_SECONDS = 60.0


def start_world_model(system: ReplaySystem, scene: Scene, workspace: Path | None, reasoners: list[str]) -> None:
    """Starts a world model with a scene, and waits for it.

    :param reasoners: Python packages of reasoners.
    """
    parameters = {"workspace_dir": str(workspace or ""), "journal": "false", "reasoners_pkgs": reasoners}
    system.node("skiros2_world_model", "world_model_server_node", "/wm", parameters)
    rospy.wait_for_service("/wm/snapshot", READY_SECONDS)
    transact = rospy.ServiceProxy("/wm/transaction", srvs.WmTransaction)
    transact("recording", "", [operation2msg(o) for o in scene_operations(scene, Scene())])


def start_skill_manager(system: ReplaySystem, recording: Recording, manager: str, scene: Scene) -> None:
    """Starts a skill manager with its recorded parameters, and waits for it.

    :param scene: the scene with its robot and skills.
    :raises BagError: the scene has no robot of the manager.
    """
    system.node("skiros2_skill", "skill_manager_node", manager, _manager_parameters(recording, manager, scene))
    rospy.wait_for_service(f"{manager}/command", READY_SECONDS)


def start_task_manager(system: ReplaySystem, recording: Recording) -> None:
    """Starts the task manager; does not wait for it."""
    system.node("skiros2_task", "task_manager_node", "/tm", _private(recording, "/tm"))


def _private(recording: Recording, node: str) -> dict[str, Any]:
    """Returns the recorded private parameters of a node."""
    start = f"{node}/"
    return {name.removeprefix(start): v for name, v in recording.parameters.items() if name.startswith(start)}


def _manager_parameters(recording: Recording, manager: str, scene: Scene) -> dict[str, Any]:
    robots = [
        n
        for n in scene
        if SKILL_MGR in n.properties and any(matching_name(v, [manager]) for v in n.properties[SKILL_MGR].values)
    ]
    if not robots:
        raise BagError(f"{recording.path}: the recorded scene has no robot of the skill manager {manager}")
    known = _private(recording, manager)
    if "libraries_list" in known:
        return known
    skills = [scene.record(dst) for _, _, dst in scene.relations(robots[0].id, ["skiros:hasSkill"])]
    modules = {str(n.properties["skiros:PythonModule"].values[0]) for n in skills if n is not None}
    return {
        "prefix": robots[0].label.rpartition(":")[0] or "skiros",
        "libraries_list": sorted({module.partition(".")[0] for module in modules}),
        "primitive_list": [n.label for n in skills if n is not None],
        "skill_list": [],
    }
