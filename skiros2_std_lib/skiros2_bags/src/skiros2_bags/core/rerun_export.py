"""Converts a bag to a recording for the Rerun viewer.

Entities, all on the timeline `time` (s since the epoch):

- `tasks/ROBOT/TASK/NODE/...`: the state of each node (a Gantt chart of the tree); `log/ROBOT`: messages of nodes.
- `skills/ROBOT`: the skill of the task request that runs; `plan/ROBOT`: the steps as they were planned.
- `scene/elements/ID`: the elements of the world model with a pose, as boxes. `scene/tf`: transforms.
- `robot_NAME`: the robot of each recorded parameter `robot_description`, at the joints that tf reports.
- `images/TOPIC`, `forces/TOPIC`: pictures, depth images, forces and torques (N, Nm).
"""

from __future__ import annotations

import json
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.urdf import UrdfTree

from skiros2_bags.core.bag_file import MONITOR, Message
from skiros2_bags.core.run import Run
from skiros2_common.core.operations import RESET
from skiros2_common.core.world_element import Element
from skiros2_runs.core.states import FAILURE, state_name
from skiros2_runs.core.task_run import TaskRun
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene

_TF, _TF_STATIC = "/tf", "/tf_static"
_IMAGE, _COMPRESSED, _WRENCH = "sensor_msgs/Image", "sensor_msgs/CompressedImage", "geometry_msgs/WrenchStamped"
_FEEDBACK = "skiros2_msgs/AchieveActionFeedback"

#: When a frame was where: time (s), parent, position (m) and orientation (x, y, z, w).
_Moved = tuple[float, str, tuple[float, float, float], tuple[float, float, float, float]]

#: Ends a state. None would leave the state as it is, and `rerun rrd verify` refuses an array with a null.
_NO_STATE = ""

#: Channels and type of the encodings of `sensor_msgs/Image` that are shown; of depth images the unit (m).
_COLOURS: dict[str, tuple[Literal["RGB", "BGR", "RGBA", "BGRA", "L"], int]] = {
    "rgb8": ("RGB", 3), "bgr8": ("BGR", 3), "rgba8": ("RGBA", 4), "bgra8": ("BGRA", 4), "mono8": ("L", 1),
}  # fmt: skip
_DEPTHS = {"32FC1": ("f4", 1.0), "16UC1": ("u2", 0.001)}


def export_rerun(run: Run, target: Path) -> int:
    """Writes a recording; returns the number of its tasks.

    :raises BagError: the bag cannot be read.
    :raises OSError: the file cannot be written.
    """
    target.open("wb").close()  # Rerun reports a folder that cannot be written only to its log
    export = _Export(run)
    export.recording.save(target)
    tasks = export.write()
    export.recording.flush()
    export.recording.disconnect()
    return tasks


class _Export:
    def __init__(self, run: Run) -> None:
        self.run = run
        self.recording = rr.RecordingStream("skiros2", recording_id=str(run.path.name))
        self._tf = list(run.messages(_TF, _TF_STATIC))
        self._moved = {t.child_frame_id.lstrip("/") for message in self._tf for t in message.content.transforms}

    def write(self) -> int:
        types = set(self.run.topics.values())
        tasks = self.run.tasks() if "skiros2_msgs/TreeProgress" in types else []
        for task in tasks:
            self._write_task(task)
        self._write_skills(tasks)
        self._write_plans()
        parents: Counter[str] = Counter()
        if MONITOR in types:
            self._write_scene(parents)
        self._write_tf(parents)
        robots = self._write_robots()
        for message in self.run.messages(_IMAGE, _COMPRESSED, _WRENCH):
            self._write_sensor(message)
        roots = [frame for frame, _ in parents.most_common() if frame not in self._moved]
        if roots:
            self.recording.log("scene", rr.CoordinateFrame(roots[0]), static=True)
        self.recording.send_blueprint(_blueprint(robots))
        return len(tasks)

    def _at(self, time: float) -> None:
        self.recording.set_time("time", timestamp=time)

    # -- tasks -------------------------------------------------------------------------------------------------

    def _write_task(self, task: TaskRun) -> None:
        known: dict[str, int] = {}
        begin = ("tasks", task.robot.strip("/"), f"{task.task_id} {task.latest.shape.skills_text(3)}")
        for frame in task.frames():
            self._at(frame.time)
            shape = frame.shape
            for index in range(1, len(shape)):
                numbers = shape.index_paths[index]
                names = [f"{number + 1} {name}" for number, name in zip(numbers, shape.path_names(index), strict=True)]
                path, state = _path(*begin, *names), frame.state(index)
                if known.get(path) != state:
                    known[path] = state
                    self.recording.log(path, rr.StateChange(state=state_name(state)))
        for line in task.log.lines:
            self._at(line.time)
            level = "ERROR" if line.state == FAILURE else "INFO"
            text = rr.TextLog(f"{line.name}: {line.message}", level=level)
            self.recording.log(_path("log", task.robot.strip("/")), text)

    def _write_skills(self, tasks: list[TaskRun]) -> None:
        for skill in self.run.skills() if tasks else []:
            if skill.depth == 1:
                path = _path("skills", skill.robot.strip("/"))
                self._at(skill.start)
                self.recording.log(path, rr.StateChange(state=skill.label))
                self._at(skill.end)
                self.recording.log(path, rr.StateChange(state=_NO_STATE))

    def _write_plans(self) -> None:
        """Writes the schedule of each plan from the time at which it was published."""
        last = ""
        for message in self.run.messages(_FEEDBACK):
            text = message.content.feedback.plan
            if not text or text == last:
                continue
            last = text
            for step in json.loads(text):
                path = _path("plan", step["robot"].strip("/"))
                self._at(message.time + step.get("start", 0.0))
                self.recording.log(path, rr.StateChange(state=step["label"]))
                self._at(message.time + step.get("end", 0.0))
                self.recording.log(path, rr.StateChange(state=_NO_STATE))

    # -- the scene ---------------------------------------------------------------------------------------------

    def _write_scene(self, parents: Counter[str]) -> None:
        scene, shown = Scene(), set[str]()
        for timed in self.run.changes():
            apply_change(scene, timed.change)
            self._at(timed.time)
            changed = {element.id for element in timed.change.elements}
            for eid in changed | shown if timed.change.action == RESET else changed:
                element = scene.element(eid)
                if element is not None and self._write_element(element, parents):
                    shown.add(eid)
                elif eid in shown:
                    shown.discard(eid)
                    self.recording.log(_path("scene", "elements", eid), rr.Clear(recursive=True))

    def _write_element(self, element: Element, parents: Counter[str]) -> bool:
        """Writes pose and box of an element. Returns whether it has a pose."""
        frame = space.text(element, space.BASE_FRAME).lstrip("/")
        own = (space.text(element, space.FRAME) or element.id).lstrip("/")
        pose = space.pose_of(element)
        if pose is None or not frame or frame == own:
            return False
        parents[frame] += 1
        path = _path("scene", "elements", element.id)
        if own not in self._moved:
            self.recording.log(path, rr.Transform3D(
                translation=pose.position, quaternion=rr.Quaternion(xyzw=pose.orientation), parent_frame=frame,
                child_frame=own,
            ))  # fmt: skip
        self.recording.log(path, rr.CoordinateFrame(own))
        size = [edge for edge in space.numbers(element, space.SIZE) if edge is not None and edge > 0.0]
        if len(size) == 3:
            label = element.label or element.id
            self.recording.log(path, rr.Boxes3D(sizes=[size], labels=[label], show_labels=False, fill_mode="solid"))
        return True

    def _write_tf(self, parents: Counter[str]) -> None:
        moving: defaultdict[str, list[_Moved]] = defaultdict(list)
        for message in self._tf:
            for each in message.content.transforms:
                parent, child = each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/")
                parents[parent] += 1
                t, q = each.transform.translation, each.transform.rotation
                moved = message.time, parent, (t.x, t.y, t.z), (q.x, q.y, q.z, q.w)
                if message.topic == _TF_STATIC:
                    transform = rr.Transform3D(
                        translation=moved[2], quaternion=rr.Quaternion(xyzw=moved[3]), parent_frame=parent,
                        child_frame=child,
                    )  # fmt: skip
                    self.recording.log(_path("scene", "tf", child), transform, static=True)
                else:
                    moving[child].append(moved)
        for child, rows in moving.items():  # one by one, they would take ten times as long
            times = rr.TimeColumn("time", timestamp=[row[0] for row in rows])
            self.recording.send_columns(_path("scene", "tf", child), [times], _columns(rows, child))

    def _write_robots(self) -> list[str]:
        """Writes the robots. Returns their entities."""
        found = self.run.robot_descriptions()
        for name, (urdf, prefix) in found.items():
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "robot.urdf"
                path.write_text(urdf)
                frame_prefix = f"{prefix.strip('/')}/" if prefix.strip("/") else None
                tree = UrdfTree.from_file_path(path, f"robot_{name}", frame_prefix=frame_prefix)
                has_tf = any((frame_prefix or "") + joint.child_link in self._moved for joint in tree.joints())
                self.recording.send_chunks(tree.stream(include_joint_transforms=not has_tf))
        return [f"robot_{name}" for name in found]

    # -- sensors -----------------------------------------------------------------------------------------------

    def _write_sensor(self, message: Message) -> None:
        self._at(message.time)
        content = message.content
        if message.type == _WRENCH:
            force, torque = content.wrench.force, content.wrench.torque
            values = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
            self.recording.log(_path("forces", *message.topic.strip("/").split("/")), rr.Scalars(values))
        elif message.type == _COMPRESSED:
            image = rr.EncodedImage(contents=bytes(content.data))
            self.recording.log(_path("images", *message.topic.strip("/").split("/")), image)
        elif (shown := _image(content)) is not None:
            self.recording.log(_path("images", *message.topic.strip("/").split("/")), shown)


def _columns(rows: list[_Moved], child: str) -> Any:
    return rr.Transform3D.columns(
        translation=[row[2] for row in rows],
        quaternion=[row[3] for row in rows],
        parent_frame=[row[1] for row in rows],
        child_frame=[child] * len(rows),
    )


def _image(content: Any) -> Any:
    """Returns an image or depth image; None for an encoding that is not shown."""
    data = np.frombuffer(bytes(content.data), np.uint8).reshape(content.height, content.step)
    if content.encoding in _COLOURS:
        model, channels = _COLOURS[content.encoding]
        pixels = data[:, : content.width * channels].reshape(content.height, content.width, channels)
        return rr.Image(pixels.squeeze() if channels == 1 else pixels, color_model=model)
    if content.encoding in _DEPTHS:
        kind, unit = _DEPTHS[content.encoding]
        order = ">" if content.is_bigendian else "<"
        pixels = data[:, : content.width * np.dtype(kind).itemsize].copy().view(order + kind)
        return rr.DepthImage(pixels.astype(kind), meter=1.0 / unit)
    return None


def _path(*parts: str) -> str:
    return "/".join(rr.escape_entity_path_part(part) for part in parts)


def _blueprint(robots: list[str]) -> rrb.Blueprint:
    states = rrb.StateTimelineView(origin="/", contents=["/skills/**", "/plan/**", "/tasks/**"], name="Tasks")
    shown = ["/scene/**", *(f"/{robot}/**" for robot in robots)]
    left = rrb.Vertical(rrb.Spatial3DView(origin="/scene", contents=shown, name="Scene"), states)
    right = rrb.Vertical(
        rrb.TimeSeriesView(origin="/forces", name="Forces"), rrb.Spatial2DView(origin="/images", name="Images"),
        rrb.TextLogView(origin="/log", name="Log"),
    )  # fmt: skip
    return rrb.Blueprint(rrb.Horizontal(left, right, column_shares=[2, 1]))
