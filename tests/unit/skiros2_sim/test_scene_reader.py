"""Reading a simulated world from a scene, and problems of scenes."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.world_element import Element
from skiros2_motion.core.bore import Bore, Latch
from skiros2_motion.core.geometry import IDENTITY, Pose, from_euler
from skiros2_sim.core.scene_reader import load_scene, read_scene
from skiros2_sim.core.scene_spec import SceneSpec
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core import spatial_data
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.ros import ROOT
from support.simulated_cell import PANDA, at

LIBRARY = ROOT / "skiros2_std_lib"
SCENE = "skiros:Scene-0"
ROBOT, BASE, ARM, GRIPPER, CAMERA = (
    "cora:Robot-1",
    "rparts:RoboticBase-2",
    "rparts:ArmDevice-3",
    "rparts:GripperEffector-4",
    "skiros:DepthCamera-5",
)
TABLE, PRODUCT = "skiros:Container-6", "skiros:Product-7"
NAN = float("nan")

ONTOLOGY = LocalWorldModel()


def element(
    eid: str,
    label: str = "",
    pose: Pose | None = IDENTITY,
    size: Sequence[float] | None = None,
    contains: Sequence[str] = (),
    has: Sequence[str] = (),
    **properties: Any,
) -> Element:
    made = Element(eid.rpartition("-")[0], label, eid)
    if pose is not None:
        spatial_data.set_pose(made, pose)
    if size is not None:
        spatial_data.set_numbers(made, spatial_data.SIZE, size)
    for key, value in properties.items():
        made.setProperty(f"skiros:{key}", value)
    for relation, children in (("skiros:contain", contains), ("skiros:hasA", has)):
        for child in children:
            made.addRelation("-1", relation, child)
    return made


def read(*elements: Element) -> SceneSpec:
    return read_scene(elements, ONTOLOGY.is_subclass)


def problems_of(scene: SceneSpec, eid: str) -> list[str]:
    assert {problem.element for problem in scene.problems} <= {eid}, scene.problems
    return [problem.reason for problem in scene.problems]


def robot(**properties: Any) -> list[Element]:
    return [
        element(ROBOT, "demo:mobile_manipulator", at(1.0, 0.0, 0.0), has=(BASE, ARM), **properties),
        element(BASE, "Base", CadModel="husky/husky.urdf"),
        element(ARM, "Left arm", at(0.3, 0.0, 0.4), has=(GRIPPER, CAMERA), CadModel=PANDA),
        element(GRIPPER, "Gripper"),
        element(CAMERA, "Camera", at(0.05, 0.0, 0.0)),
    ]


# -- scenes that are right --------------------------------------------------------------------------------------------


def test_bodies_have_map_poses_and_manipulatables_are_movable() -> None:
    turned = Pose((2.0, 1.0, 0.4), from_euler(0.0, 0.0, math.pi / 2))
    scene = read(
        element(SCENE, contains=(TABLE, "skiros:Location-8")),
        element(TABLE, "Table", turned, (0.8, 1.2, 0.8), contains=(PRODUCT,)),
        element(PRODUCT, "Bolt", at(0.3, 0.0, 0.45), (0.1, 0.1, 0.1), Weight=0.3),
        element("skiros:Location-8", "Corner", at(3.0, 0.0, 0.0)),
    )
    assert scene.problems == ()
    assert scene.robots == ()
    table, bolt = scene.bodies
    assert (table.id, table.movable, table.size, table.parent) == (TABLE, False, (0.8, 1.2, 0.8), SCENE)
    assert (bolt.id, bolt.movable, bolt.parent, bolt.mass) == (PRODUCT, True, TABLE, pytest.approx(0.3))
    assert (bolt.type, bolt.label) == ("skiros:Product", "Bolt")
    assert bolt.pose.position == pytest.approx((2.0, 1.3, 0.85))


def test_pose_may_be_in_another_element_or_the_map() -> None:
    scene = read(
        element(SCENE, contains=(TABLE,), FrameId="world"),
        element(TABLE, "", at(1.0, 0.0, 0.0), (1.0, 1.0, 1.0), FrameId="table"),
        element(PRODUCT, "", at(0.1, 0.0, 0.0), (0.1, 0.1, 0.1), BaseFrameId="table"),
        element("skiros:Product-8", "", at(0.1, 0.0, 0.0), (0.1, 0.1, 0.1), BaseFrameId="world"),
        element("skiros:Product-9", "", at(0.1, 0.0, 0.0), (0.1, 0.1, 0.1), BaseFrameId=PRODUCT),
    )
    assert scene.map_frame == "world"
    assert [body.pose.position[0] for body in scene.bodies] == pytest.approx([1.0, 1.1, 0.1, 1.2])


def test_robot_has_parts_and_default_names() -> None:
    scene = read(element(SCENE, contains=(ROBOT,)), *robot())
    assert scene.problems == ()
    assert scene.bodies == ()
    (made,) = scene.robots
    assert (made.name, made.pose.position) == ("mobile_manipulator", (1.0, 0.0, 0.0))
    assert made.move_action == "/mobile_manipulator/move_base"
    assert made.base is not None
    assert made.base.model == "husky/husky.urdf"
    (arm,) = made.arms
    assert (arm.name, arm.model, arm.pose) == ("left_arm", PANDA, at(0.3, 0.0, 0.4))
    assert arm.trajectory_action == "/mobile_manipulator/left_arm/follow_joint_trajectory"
    assert arm.cartesian_action == "/mobile_manipulator/left_arm/cartesian_motion"
    assert arm.planning_action == "/mobile_manipulator/left_arm/plan_motion"
    assert arm.wrench_topic == "/mobile_manipulator/left_arm/wrench"
    assert arm.stiffness_topic == "/mobile_manipulator/left_arm/stiffness"
    assert (arm.position_controller, arm.compliant_controller) == ("position", "compliant")
    assert arm.gripper is not None
    assert arm.gripper.action == "/mobile_manipulator/gripper/gripper_action"
    (camera,) = made.cameras
    assert (camera.parent, camera.name) == (ARM, "camera")
    assert camera.rgb_topic == "/mobile_manipulator/camera/color/image_raw"
    assert camera.depth_topic == "/mobile_manipulator/camera/depth/image_raw"


def test_names_in_elements_override_defaults() -> None:
    parts = robot(NavigationExe="/drive")
    for key in ("MotionExe", "CartesianGoalAction", "MotionPlanner", "CartesianWrenchTopic", "CartesianStiffnessTopic"):
        parts[2].setProperty(f"skiros:{key}", f"/{key}")
    parts[2].setProperty("skiros:CompliantController", "soft")
    parts[3].setProperty("skiros:DriverAddress", "/grip")
    parts[4].setProperty("skiros:RgbTopic", "/rgb")
    (made,) = read(*parts).robots
    (arm,) = made.arms
    assert made.move_action == "/drive"
    assert arm.trajectory_action == "/MotionExe"
    assert (arm.cartesian_action, arm.wrench_topic) == ("/CartesianGoalAction", "/CartesianWrenchTopic")
    assert arm.planning_action == "/MotionPlanner"
    assert (arm.stiffness_topic, arm.compliant_controller) == ("/CartesianStiffnessTopic", "soft")
    assert arm.gripper is not None
    assert (arm.gripper.action, made.cameras[0].rgb_topic) == ("/grip", "/rgb")


def test_arm_of_moveit_has_no_planner() -> None:
    parts = robot()
    parts[2].setProperty("skiros:MotionPlanner", "/move_group")
    parts[2].setProperty("skiros:MoveItGroup", "left")
    (made,) = read(*parts).robots
    assert made.arms[0].planning_action == ""


def test_camera_may_be_mounted_on_a_body_or_the_map() -> None:
    scene = read(
        element(SCENE, contains=(TABLE, "skiros:DepthCamera-8")),
        element(TABLE, "", at(1.0, 0.0, 0.5), (1.0, 1.0, 1.0), has=(CAMERA,)),
        element(CAMERA, "On the table", at(0.0, 0.0, 1.0)),
        element("skiros:DepthCamera-8", "", at(2.0, 0.0, 1.0)),
    )
    on_table, in_map = scene.cameras
    assert (on_table.parent, on_table.name) == (TABLE, "on_the_table")
    assert (in_map.parent, in_map.name) == ("", "part_8")
    with World(scene) as world:
        assert world.pose_of(on_table.id).position == pytest.approx((1.0, 0.0, 1.5))
        assert world.pose_of(in_map.id).position == pytest.approx((2.0, 0.0, 1.0))


@pytest.mark.parametrize(
    "file",
    [
        "demos/timed_skills/owl/pick_place_scene.ttl",
        "demos/pick_and_place/owl/sim_scene.ttl",
        "demos/pick_and_place/owl/three_robots_scene.ttl",
    ],
)
def test_library_scenes_are_stable(file: str) -> None:
    path = LIBRARY / file
    scene = load_scene(path.name, path.parent)
    assert scene.robots
    with World(scene) as world:
        assert world.problems == list(scene.problems)
        start = {eid: world.pose_of(eid) for eid, body in world.bodies.items() if body.movable}
        assert start
        world.step(240)
        for eid, pose in start.items():
            assert world.pose_of(eid).position == pytest.approx(pose.position, abs=2e-3)


# -- scenes that are wrong --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", ["none.ttl", "", "../../x.ttl", "broken.ttl"])
def test_invalid_scene_file_is_named(tmp_path: Path, file: str) -> None:
    (tmp_path / "broken.ttl").write_text("@prefix")
    with pytest.raises(ConfigurationError) as caught:
        load_scene(file, tmp_path)
    assert file in str(caught.value)


def test_scene_without_poses_omits_bodies() -> None:
    scene = read(
        element(SCENE, pose=None, contains=(ROBOT, TABLE)),
        element(TABLE, "", None, (1.0, 1.0, 1.0), contains=(PRODUCT,)),
        element(PRODUCT, "", at(0.0, 0.0, 1.0), (0.1, 0.1, 0.1)),
        element(ROBOT, "demo:r", None),
    )
    reasons = {problem.element: problem.reason for problem in scene.problems}
    assert set(reasons) == {TABLE, PRODUCT, ROBOT}
    assert "its pose is missing" in reasons[TABLE]
    assert TABLE in reasons[PRODUCT]
    assert "origin" in reasons[ROBOT]
    assert scene.bodies == ()
    with World(scene) as world:
        world.step(10)
        assert world.pose_of(ROBOT).position == (0.0, 0.0, 0.0)
        assert [problem.element for problem in world.problems] == [problem.element for problem in scene.problems]


@pytest.mark.parametrize(
    ("size", "pose", "expected"),
    [
        ((NAN, 1.0, 1.0), IDENTITY, "size"),
        ((0.0, 1.0, 1.0), IDENTITY, "size"),
        ((-1.0, 1.0, 1.0), IDENTITY, "size"),
        ((float("inf"), 1.0, 1.0), IDENTITY, "size"),
        ((1e9, 1.0, 1.0), IDENTITY, "size"),
        ((1.0, 1.0, None), IDENTITY, "size"),
        ((0.1, 0.1, 0.1), at(NAN, 0.0, 0.0), "pose"),
        (None, IDENTITY, "neither a size nor a model"),
    ],
)
def test_product_without_shape_is_omitted(size: Any, pose: Pose, expected: str) -> None:
    scene = read(element(SCENE, contains=(PRODUCT,)), element(PRODUCT, "", pose, size))
    assert any(expected in reason for reason in problems_of(scene, PRODUCT))
    assert scene.bodies == ()


@pytest.mark.parametrize("weight", [NAN, 0.0, -1.0, float("inf")])
def test_invalid_weight_is_ignored(weight: float) -> None:
    scene = read(element(PRODUCT, "", IDENTITY, (0.1, 0.1, 0.1), Weight=weight))
    assert "weight" in problems_of(scene, PRODUCT)[0]
    assert scene.bodies[0].mass is None


def test_duplicate_robot_name_is_numbered() -> None:
    scene = read(element(ROBOT, "demo:r"), element("cora:Robot-8", "other:r"))
    assert [made.name for made in scene.robots] == ["r", "r_8"]
    assert problems_of(scene, "cora:Robot-8") == ["renamed to r_8: the name r is taken"]
    with World(scene) as world:
        assert len(world.robots) == 2


def test_duplicate_and_surplus_parts_are_reported() -> None:
    parts = [
        element(ROBOT, "demo:r", has=(BASE, "rparts:RoboticBase-8", ARM, "rparts:ArmDevice-9")),
        element(BASE, "Base"),
        element("rparts:RoboticBase-8", "Base"),
        element(ARM, "Arm", has=(GRIPPER, "rparts:GripperEffector-10"), CadModel=PANDA),
        element(GRIPPER, "Arm"),
        element("rparts:GripperEffector-10", "Hand"),
        element("rparts:ArmDevice-9", "Other"),
    ]
    scene = read(*parts)
    reasons = {problem.element: problem.reason for problem in scene.problems}
    assert set(reasons) == {"rparts:RoboticBase-8", GRIPPER, "rparts:GripperEffector-10", "rparts:ArmDevice-9"}
    assert BASE in reasons["rparts:RoboticBase-8"]
    assert "no model" in reasons["rparts:ArmDevice-9"]
    (arm,) = scene.robots[0].arms
    assert arm.gripper is not None
    assert arm.gripper.name == "arm_4"


def test_invalid_and_duplicate_interface_names_use_the_default() -> None:
    parts = robot(NavigationExe="no name!")
    parts[2].setProperty("skiros:MotionExe", "/go")
    parts[2].setProperty("skiros:CartesianGoalAction", "/go")
    scene = read(*parts)
    (made,) = scene.robots
    assert made.move_action == "/mobile_manipulator/move_base"
    assert made.arms[0].trajectory_action == "/go"
    assert made.arms[0].cartesian_action == "/mobile_manipulator/left_arm/cartesian_motion"
    reasons = {problem.element: problem.reason for problem in scene.problems}
    assert "skiros:NavigationExe 'no name!' is not a valid ROS name" in reasons[ROBOT]
    assert "skiros:CartesianGoalAction '/go' is taken" in reasons[ARM]


def test_camera_on_an_omitted_body_is_omitted() -> None:
    parts = robot()
    parts[2].setProperty("skiros:CadModel", "nowhere.urdf")
    with World(read(*parts)) as world:
        assert world.cameras == {}
        assert CAMERA in [problem.element for problem in world.problems]


def test_parent_cycles_are_broken() -> None:
    scene = read(
        element(TABLE, "", at(1.0, 0.0, 0.0), (1.0, 1.0, 1.0), contains=(PRODUCT,)),
        element(PRODUCT, "", at(1.0, 0.0, 0.0), (0.1, 0.1, 0.1), contains=(TABLE,)),
        element("skiros:Product-8", "", IDENTITY, (0.1, 0.1, 0.1), BaseFrameId="skiros:Product-8"),
    )
    reasons = {problem.element: problem.reason for problem in scene.problems}
    assert set(reasons) == {TABLE, "skiros:Product-8"}
    assert PRODUCT in reasons[TABLE]
    assert "depends on itself" in reasons["skiros:Product-8"]
    assert [body.pose.position[0] for body in scene.bodies] == [1.0, 2.0]


def test_overlap_is_reported_and_resolved() -> None:
    scene = read(
        element(TABLE, "", at(0.0, 0.0, 0.25), (1.0, 1.0, 0.5)),
        element(PRODUCT, "", at(0.0, 0.0, 0.48), (0.1, 0.1, 0.1)),
        element("skiros:Product-8", "", at(0.02, 0.0, 0.58), (0.1, 0.1, 0.1)),
    )
    with World(scene) as world:
        assert {problem.element for problem in world.problems} == {TABLE, PRODUCT}
        problem = next(found for found in world.problems if found.element == TABLE)
        assert PRODUCT in problem.reason
        assert "0.070 m" in problem.reason
        world.step(240)
        lower, upper = world.pose_of(PRODUCT).position, world.pose_of("skiros:Product-8").position
        assert lower[2] == pytest.approx(0.55, abs=5e-3)
        assert upper[2] == pytest.approx(0.65, abs=5e-3)
        assert max(map(abs, (*lower[:2], *upper[:2]))) < 0.1, "nothing was thrown away"


# -- bores ------------------------------------------------------------------------------------------------------------


BORE = "skiros:Bore-8"


def test_bores_of_a_box_are_read() -> None:
    block = element(TABLE, size=(0.2, 0.1, 0.06), has=(BORE,))
    bore = element(BORE, pose=at(0.04, 0.0, 0.03), Diameter=0.0402, Depth=0.05, Chamfer=0.002)
    scene = read(element(SCENE, contains=(TABLE,)), block, bore)
    assert scene.problems == ()
    assert [body.bores for body in scene.bodies] == [(Bore(0.04, 0.0, 0.0402, 0.05, 0.002),)]


def test_latch_of_a_bore_is_read() -> None:
    block = element(TABLE, size=(0.2, 0.1, 0.06), has=(BORE,))
    numbers = {"Diameter": 0.0402, "Depth": 0.05, "LatchDepth": 0.045, "LatchForce": 18.0, "RetentionForce": 30.0}
    scene = read(element(SCENE, contains=(TABLE,)), block, element(BORE, pose=at(0.04, 0.0, 0.03), **numbers))
    assert scene.problems == ()
    assert [bore.latch for body in scene.bodies for bore in body.bores] == [Latch(0.045, 18.0, 30.0)]


@pytest.mark.parametrize("change", [{"LatchDepth": 0.05}, {"LatchForce": NAN}, {"RetentionForce": 0.0}])
def test_invalid_latch_is_a_problem(change: dict[str, Any]) -> None:
    numbers = {"Diameter": 0.0402, "Depth": 0.05, "LatchDepth": 0.045, "LatchForce": 18.0, "RetentionForce": 30.0}
    bore = element(BORE, pose=at(0.04, 0.0, 0.03), **numbers | change)
    scene = read(element(SCENE, contains=(TABLE,)), element(TABLE, size=(0.2, 0.1, 0.06), has=(BORE,)), bore)
    (problem,) = scene.problems
    assert problem.element == BORE
    assert "without its latch: expected skiros:LatchDepth" in problem.reason


@pytest.mark.parametrize(
    ("size", "change", "reason"),
    [
        ((0.2, 0.1, 0.06), {"Diameter": 0.2}, "without its bores: bore at .* diameter 0.2 m"),
        ((0.2, 0.1, 0.06), {"Depth": "deep"}, "omitted: expected a pose, skiros:Diameter and skiros:Depth"),
        ((0.2, 0.1, 0.06), {"Depth": NAN}, "expected a pose, skiros:Diameter and skiros:Depth|without its bores"),
        (None, {}, "without its bores .*expected a box"),
    ],
)
def test_invalid_bores_are_problems(size: Sequence[float] | None, change: dict[str, Any], reason: str) -> None:
    bore = element(BORE, pose=at(0.04, 0.0, 0.03), **({"Diameter": 0.04, "Depth": 0.05} | change))
    block = element(TABLE, size=size, has=(BORE,), **({} if size else {"CadModel": "cube.urdf"}))
    scene = read(element(SCENE, contains=(TABLE,)), block, bore)
    assert [body.bores for body in scene.bodies] == [()]
    assert re.search(reason, str(scene.problems[0]))
