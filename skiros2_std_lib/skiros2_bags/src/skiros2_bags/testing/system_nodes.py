"""Nodes of the platform, started as they were when a bag was recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.lab import Lab
from skiros2_bags.testing.past_world import whole_scene
from skiros2_bags.testing.recording import Recording
from skiros2_msgs import srv as srvs
from skiros2_skill.core.manager_names import SKILL_MGR, matching_name
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.ros.wire import operation2msg

#: How long a node may take until it is ready (s).
READY_SECONDS = 60.0


def start_world_model(lab: Lab, scene: Scene, workspace: Path | None, reasoners: list[str]) -> None:
    """Starts a world model with a scene, and waits for it.

    :param reasoners: Python packages.
    """
    parameters = {"workspace_dir": str(workspace or ""), "journal": "false", "reasoners_pkgs": reasoners}
    lab.node("skiros2_world_model", "world_model_server_node", "/wm", parameters)
    rospy.wait_for_service("/wm/snapshot", READY_SECONDS)
    transact = rospy.ServiceProxy("/wm/transaction", srvs.WmTransaction)
    transact("recording", "", [operation2msg(o) for o in whole_scene(scene, Scene())])


def start_skill_manager(lab: Lab, recording: Recording, manager: str, scene: Scene) -> None:
    """Starts a skill manager as it was, and waits for it.

    :param scene: in which it has its robot and skills.
    :raises BagError: the scene has not.
    """
    lab.node("skiros2_skill", "skill_manager_node", manager, _manager_parameters(recording, manager, scene))
    rospy.wait_for_service(f"{manager}/command", READY_SECONDS)


def start_task_manager(lab: Lab, recording: Recording) -> None:
    """Starts the task manager; does not wait for it."""
    lab.node("skiros2_task", "task_manager_node", "/tm", _private(recording, "/tm"))


def _private(recording: Recording, node: str) -> dict[str, Any]:
    """The private parameters that a node had, where the bag has them."""
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
