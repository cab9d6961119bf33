"""Merges the base, arms and grippers of a robot into one URDF.

A mobile robot has three drives in the map (x, y and yaw), which keep it upright and move it; its wheels do not turn. So
it collides with obstacles, and one model has the dynamics of the whole robot.

    anchor -x- . -y- . -turn- base_link -+- BASE/...            (the base's model)
                                         +- ARM/... -- ARM/tool (an arm's model; fingers in it or in a gripper's own)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.geometry import IDENTITY, Pose, angle_between, from_euler, to_euler
from skiros2_motion.core.urdf import MOVING, Urdf, as_text, limits_of
from skiros2_sim.core import urdf as models
from skiros2_sim.core.scene_spec import ArmSpec, GripperSpec, Problem, RobotSpec
from skiros2_sim.core.urdf import find_model, read_urdf

BASE_LINK = "base_link"
#: The drives of a mobile robot.
DRIVES = ("drive_x", "drive_y", "drive_turn")

#: Start posture by name of the model, for arms without a posture `start` in the scene.
_REST = {
    "panda": (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785),
    "lbr_iiwa": (0.0, 0.5, 0.0, -1.5, 0.0, 1.1, 0.0),
}
#: Tool frame in the frame of the last link, by name of the model, for models without a link for it.
_TOOL = {"lbr_iiwa": Pose((0.0, 0.0, 0.045), IDENTITY.orientation)}
_TOOL_LINKS = ("grasptarget", "tool", "tool0", "tcp")

#: PyBullet's notation for a prismatic joint without limits.
_UNLIMITED = (0.0, -1.0)

#: Maximum tilt (rad) of a mobile robot that counts as upright.
TILT = 0.01


@dataclass(frozen=True)
class ArmModel:
    """An arm in the robot's model.

    :param mount: name of its first link.
    :param joints: names of the joints that move the tool, from the mount on.
    :param fingers: names of the finger joints; positive positions open.
    :param rest: initial positions of `joints`.
    """

    spec: ArmSpec
    mount: str
    tool: str
    joints: tuple[str, ...]
    fingers: tuple[str, ...]
    rest: tuple[float, ...]


@dataclass
class RobotModel:
    """The merged model of a robot.

    :param pose: initial pose of its `base_link` in the map.
    :param base_links: the links of the base, which stands on the ground.
    """

    urdf: str
    mobile: bool
    pose: Pose
    arms: list[ArmModel] = field(default_factory=list)
    base_links: list[str] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)


def merge_models(spec: RobotSpec, folders: Sequence[str] = ()) -> RobotModel:
    """Merges the models of a robot. Models that do not load are omitted and listed in `problems`.

    :param folders: folders to search for models.
    """
    made = RobotModel("", False, spec.pose)
    base = _base_model(spec, folders, made.problems)
    made.mobile = base is not None
    if made.mobile:
        made.pose = upright(spec.pose)
        if angle_between(made.pose.orientation, spec.pose.orientation) > TILT:
            made.problems.append(Problem(spec.id, "a mobile robot stands upright: its tilt is ignored"))
    parts = _drives() if made.mobile else []
    parts.append(models.link(BASE_LINK, size=spec.size if spec.base is None else None))
    made.base_links.append(BASE_LINK)
    if spec.base is not None:
        root = base.root() if base is not None else spec.base.name
        parts += _fixed_wheels(base) if base is not None else [models.link(root, size=spec.base.size or spec.size)]
        parts.append(models.joint(f"{spec.base.name}/mount", "fixed", BASE_LINK, root, spec.base.pose))
        made.base_links += base.links if base is not None else [root]
    for arm in spec.arms:
        try:
            parts += _add_arm(arm, folders, made)
        except ConfigurationError as error:
            made.problems.append(Problem(arm.id, f"omitted: {error}", arm.model))
    made.urdf = as_text(spec.name, parts)
    return made


def upright(pose: Pose) -> Pose:
    """Returns the pose with rotation about z only."""
    return Pose(pose.position, from_euler(0.0, 0.0, to_euler(pose.orientation)[2]))


def _base_model(spec: RobotSpec, folders: Sequence[str], problems: list[Problem]) -> Urdf | None:
    base = spec.base
    if base is None or not base.model:
        return None
    try:
        return read_urdf(find_model(base.model, folders), f"{base.name}/")
    except ConfigurationError as error:
        problems.append(Problem(base.id, f"the robot is fixed in the map: {error}", base.model))
        return None


def _drives() -> list[Element]:
    """Creates the anchor in the map and the three drives."""
    x, y, turn = DRIVES
    return [
        models.link("anchor"),
        models.link(x, 1.0),
        models.link(y, 1.0),
        models.joint(x, "prismatic", "anchor", x, axis="1 0 0", limits=_UNLIMITED),
        models.joint(y, "prismatic", x, y, axis="0 1 0", limits=_UNLIMITED),
        models.joint(turn, "continuous", y, BASE_LINK, axis="0 0 1"),
    ]


def _fixed_wheels(base: Urdf) -> list[Element]:
    for joint in base.joints:
        joint.set("type", "fixed")
    return base.parts


def _add_arm(spec: ArmSpec, folders: Sequence[str], robot: RobotModel) -> list[Element]:
    """Adds an arm to the robot's model. Returns its parts.

    :raises ConfigurationError: the model of arm or gripper cannot be loaded, or is not an arm.
    """
    arm = read_urdf(find_model(spec.model, folders), f"{spec.name}/")
    last = _last_link(arm)
    joints = _path(arm, last)
    if not joints:
        raise ConfigurationError(f"{spec.model} has no joint that moves its last link")
    parts = [*arm.parts, models.joint(f"{spec.name}/mount", "fixed", BASE_LINK, arm.root(), spec.pose)]
    fingers = _fingers(arm, joints)
    offset = _TOOL.get(arm.name, IDENTITY)
    holder = arm
    if spec.gripper is not None and spec.gripper.model:
        holder = _add_gripper(spec, spec.gripper, folders, last, parts)
        fingers = _fingers(holder)
        last, offset = _last_link(holder), IDENTITY
    tool = f"{spec.name}/tool"
    if tool not in holder.links:
        parts += [models.link(tool), models.joint(f"{tool}_mount", "fixed", last, tool, offset)]
    limits = [_limits(joint) for joint in joints]
    rest = _start(spec, arm.name, len(joints), robot.problems)
    robot.arms.append(
        ArmModel(
            spec,
            arm.root(),
            tool,
            tuple(joint.get("name", "") for joint in joints),
            tuple(joint.get("name", "") for joint in fingers),
            tuple(min(max(at, low), high) for at, (low, high) in zip(rest, limits, strict=True)),
        )
    )
    return parts


def _start(spec: ArmSpec, model: str, joints: int, problems: list[Problem]) -> tuple[float, ...]:
    """Returns the positions with which an arm starts, before they are limited to those of its joints."""
    for found in (spec.postures.get("start"), _REST.get(model), spec.postures.get("home")):
        if found is not None:
            if len(found) == joints:
                return found
            problems.append(Problem(spec.id, f"its start posture has {len(found)} positions, expected {joints}"))
    return (0.0,) * joints


def _add_gripper(
    spec: ArmSpec, gripper: GripperSpec, folders: Sequence[str], flange: str, parts: list[Element]
) -> Urdf:
    """Adds the parts of a gripper with its own model; returns the model."""
    model = read_urdf(find_model(gripper.model, folders), f"{spec.name}/{gripper.name}/")
    mount = f"{spec.name}/{gripper.name}/mount"
    parts += [*model.parts, models.joint(mount, "fixed", flange, model.root(), gripper.pose)]
    return model


def _fingers(model: Urdf, others: Sequence[Element] = ()) -> list[Element]:
    """Returns the prismatic joints with limits, except `others`."""
    sliding = (joint for joint in model.joints if joint.get("type") == "prismatic" and joint not in others)
    return [joint for joint in sliding if _limits(joint)[0] < _limits(joint)[1]]


def _last_link(model: Urdf) -> str:
    """Returns the tool link: by name; else the last link after the most revolute joints."""
    named = [name for name in model.links if name.rpartition("_")[2].rpartition("/")[2] in _TOOL_LINKS]
    if named:
        return named[-1]
    turning = {name: sum(j.get("type") != "prismatic" for j in _path(model, name)) for name in model.links}
    sliding = {name for name in model.links if any(j.get("type") == "prismatic" for j in _path(model, name)[-1:])}
    most = max(turning.values())
    candidates = [name for name in model.links if turning[name] == most]
    return ([name for name in candidates if name not in sliding] or candidates)[-1]


def _path(model: Urdf, link: str) -> list[Element]:
    """Returns the moving joints between the root and a link."""
    return [joint for joint in model.path(link) if joint.get("type") in MOVING]


def _limits(joint: Element) -> tuple[float, float]:
    return limits_of(joint)[:2]
