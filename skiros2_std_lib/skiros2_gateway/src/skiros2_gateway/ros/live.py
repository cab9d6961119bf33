"""What viewers of the live view ask the cell for, over ROS."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Any

import rospkg
import rospy

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.manager_names import matching_name
from skiros2_gateway.core.deadline import remaining
from skiros2_gateway.ros.ros_cell import RosCell
from skiros2_live.core.scene_view import SceneView
from skiros2_live.ros.parameters import mesh_folders
from skiros2_live.ros.world_model_watch import WorldModelWatch
from skiros2_runs.core.values import NodeStatus
from skiros2_skill.client.manager import ManagerClient

log = logging.getLogger(__name__)

#: The period of checks whether the world model answers (s).
_CHECK_PERIOD = 1.0
#: Files in the folders with meshes that viewers may read: also materials and textures.
_MESH_FILES = (".stl", ".obj", ".dae", ".mtl", ".png", ".jpg", ".jpeg", ".bmp", ".tga")


class LiveRos:
    """Implements `LiveCell`. Made and used in the thread of the loop; call `close` at the end."""

    def __init__(self, cell: RosCell) -> None:
        self._cell = cell
        self._recorded: SceneView | None = None
        self._world_model = WorldModelWatch(cell.report)
        self._world_model.start()
        self._task = asyncio.get_running_loop().create_task(self._check())

    def close(self) -> None:
        """Ends all checks."""
        self._task.cancel()
        self._world_model.close()

    # -- what viewers ask for ----------------------------------------------------------------------------------

    async def inspect(self, robot: str, task: int, node: int) -> NodeStatus:
        return await self._cell.in_thread(self._client(robot).inspect, task, node)

    async def why(self, robot: str, task: int) -> dict[str, Any]:
        why = await self._cell.in_thread(self._client(robot).why, task)
        return why.to_dict()

    async def command(self, action: str, robot: str, task: int) -> None:
        if action == "step":
            await self._cell.in_thread(self._client(robot).command, "tick_once", task)
        else:
            await self._cell.stops.command(action, [robot], rospy.get_name(), task, remaining())

    def stop_goal(self, goal_id: str) -> None:
        self._cell.stop(goal_id)

    def recorded_view(self) -> SceneView:
        if self._recorded is None:
            self._recorded = SceneView(self._is_subclass, mesh_folders())
        return self._recorded

    def _is_subclass(self, child: str, parent: str) -> bool:
        """Whether one class is a subclass of another one, as far as the world model knows both."""
        wm = self._cell.world_model
        try:
            return wm is not None and wm.is_subclass(child, parent)
        except UnknownName:
            return False

    def mesh_file(self, url: str) -> Path:
        views = [self._cell.scene.view, self._recorded]
        meshes = {mesh for view in views if view is not None for mesh in view.meshes}
        base, _, extra = url.rpartition("/")
        # A mesh file names textures and materials beside itself.
        if url not in meshes and not any(mesh.rpartition("/")[0] == base for mesh in meshes):
            raise UnknownName(f"no element or robot has the mesh {url}")
        if ".." in extra or Path(extra).suffix.lower() not in _MESH_FILES:
            raise UnknownName(f"{url} is not a mesh, and not a material or texture beside one")
        if url.startswith("package://"):
            package, _, rest = url.removeprefix("package://").partition("/")
            try:
                return Path(rospkg.RosPack().get_path(package)) / rest
            except rospkg.ResourceNotFound:
                raise UnknownName(f"{url}: there is no package {package}") from None
        return Path(url.removeprefix("file://"))

    def _client(self, robot: str) -> ManagerClient:
        agents = self._cell.managers
        name = matching_name(robot, agents)
        if not name:
            raise Refused(f"the skill manager {robot} does not run; there are: {', '.join(agents) or 'none'}")
        return agents[name]

    # -- periodically ------------------------------------------------------------------------------------------

    async def _check(self) -> None:
        while True:
            self._world_model.check()
            await asyncio.sleep(_CHECK_PERIOD)
