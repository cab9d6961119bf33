"""Models: search, errors, and merged robots."""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.geometry import IDENTITY, Pose, from_euler
from skiros2_sim.core import load_test
from skiros2_sim.core.robot_model import merge_models
from skiros2_sim.core.scene_spec import ArmSpec, BaseSpec, BodySpec, GripperSpec, RobotSpec, SceneSpec
from skiros2_sim.core.urdf import find_model, mesh_of, read_urdf
from skiros2_sim.core.world import World
from support.simulated_cell import ARM, BASE, GRIPPER, PANDA, ROBOT, at, fixed_panda, mobile_manipulator, product

TRIANGLE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"
LINK = '<link name="a"><collision><geometry><mesh filename="m.obj"/></geometry></collision></link>'


def urdf(*parts: str) -> str:
    return f'<robot name="r">{"".join(parts)}</robot>'


def joint(name: str, parent: str, child: str, kind: str = "fixed", more: str = "") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'


def links(*names: str) -> str:
    return "".join(f'<link name="{name}"/>' for name in names)


def stl(*numbers: float, triangles: int = 1) -> bytes:
    return b"\0" * 80 + struct.pack("<I", triangles) + struct.pack("<12fH", *(numbers or (0.0,) * 12), 0)


def test_workspace_is_searched_before_pybullet_data(tmp_path: Path) -> None:
    own = tmp_path / "franka_panda" / "panda.urdf"
    assert find_model(PANDA).name == "panda.urdf"
    assert find_model(PANDA, (tmp_path,)) == find_model(PANDA)
    own.parent.mkdir()
    own.touch()
    assert find_model(PANDA, (tmp_path,)) == own
    assert find_model(str(own)) == own
    assert find_model(f"file://{own}") == own
    assert find_model("package://skiros2_sim/package.xml").parent.name == "skiros2_sim"


@pytest.mark.parametrize("name", ["", "none.urdf", "package://nobody/x", "package://../x", "a\0b", "/none.urdf", "."])
def test_missing_model_is_named(name: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        find_model(name)
    assert (name if "\0" not in name else "'a\\x00b'") in str(caught.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not a URDF"),
        ("<robot", "not a URDF"),
        ("<sdf/>", "expected <robot>"),
        (urdf(), "expected links"),
        (urdf("<link/>"), "no name"),
        (urdf(links("a", "a")), "different names"),
        (urdf(links("a", "b")), "roots ['a', 'b']"),
        (urdf(links("a", "b"), joint("j", "a", "c")), "tree"),
        (urdf(links("a", "b", "c"), joint("j", "b", "c"), joint("k", "c", "b")), "tree"),
        (urdf(links("a", "b"), joint("j", "a", "b"), joint("k", "a", "b")), "tree"),
        (urdf(links("a", "b"), joint("j", "a", "b", "elastic")), "'elastic'"),
        (urdf(links("a", "b"), joint("j", "a", "b", more='<origin xyz="0 0 nan"/>')), "xyz"),
        (urdf(links("a", "b"), joint("j", "a", "b", more='<origin xyz="0 0"/>')), "3 finite numbers"),
        (urdf('<link name="a"><collision><geometry><box size="1 1 0"/></geometry></collision></link>'), "above 0"),
        (urdf('<link name="a"><inertial><mass value="-1"/></inertial></link>'), "mass"),
        (urdf('<link name="a"><inertial><mass value="inf"/></inertial></link>'), "mass"),
        (urdf(LINK.replace("m.obj", "none.obj")), "none.obj does not exist"),
        (urdf(LINK.replace("m.obj", "package://nobody/none.obj")), "none.obj does not exist"),
        (urdf(LINK.replace("m.obj", "model.urdf")), ".obj"),
    ],
)
def test_invalid_urdf_is_reported_with_file_and_reason(tmp_path: Path, text: str, reason: str) -> None:
    file = tmp_path / "model.urdf"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        read_urdf(file)
    assert str(file) in str(caught.value)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("m.obj", b"", "createCollisionShape failed"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 1e30\nf 1 2 3\n", "a vertex that is not finite"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "createCollisionShape failed"),
        ("m.obj", bytes(range(256)) * 4, "createCollisionShape failed"),
        ("m.stl", b"", "createCollisionShape failed"),
        ("m.stl", stl()[:-1], "createCollisionShape failed"),
        ("m.stl", stl(triangles=7), "createCollisionShape failed"),
        ("m.stl", stl(*(float("nan"),) * 12), "a vertex that is not finite"),
        ("m.stl", b"\0" * 84, "createCollisionShape failed"),
        ("m.png", b"", "expected one of"),
    ],
)
def test_invalid_mesh_is_reported_with_file_and_reason(tmp_path: Path, name: str, content: bytes, reason: str) -> None:
    (tmp_path / name).write_bytes(content)
    file = tmp_path / "model.urdf"
    file.write_text(urdf(LINK.replace("m.obj", name)))
    with pytest.raises(ConfigurationError) as caught:
        read_urdf(file)
    assert str(tmp_path / name) in str(caught.value)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        # Well formed, and yet: a face names a corner of a texture that is not there; a shape lacks its size.
        ("m.obj", "v 0 0 0\n" * 8 + "f 1 3/1/1\n"),
        ("m.urdf", urdf('<link name="a"><collision><geometry><cylinder/></geometry></collision></link>')),
    ],
    ids=["mesh", "urdf"],
)
def test_model_rejected_by_pybullet_is_reported(tmp_path: Path, name: str, content: str) -> None:
    (tmp_path / name).write_text(content)
    scene = SceneSpec((BodySpec("t:B-1", model=name), product("t:P-2", at(0.0, 0.0, 1.0))), models=(str(tmp_path),))
    with World(scene) as world:
        (problem,) = world.problems
        assert (problem.element, problem.file) == ("t:B-1", name)
        assert "PyBullet does not load it" in problem.reason
        world.step(10)
        assert set(world.bodies) == {"t:P-2"}


def test_crashing_model_ends_a_separate_process_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "crash.py"
    program.write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    (tmp_path / "m.obj").write_text(TRIANGLE)
    monkeypatch.setattr(load_test, "PROGRAM", program)
    assert "PyBullet crashes on it" in load_test.load_error(tmp_path / "m.obj")


def collada(corner: int = 2, copies: int = 1, triangles: int = 1) -> str:
    """A file with `copies` of triangles of the corners 0, 1 and `corner`."""

    def source(name: str, numbers: str) -> str:
        params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
        accessor = f'<accessor source="#{name}s" count="3" stride="3">{params}</accessor>'
        array = f'<float_array id="{name}s" count="9">{numbers}</float_array>'
        return f'<source id="{name}">{array}<technique_common>{accessor}</technique_common></source>'

    inputs = '<input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>'
    faces = f'<triangles count="{triangles}">{inputs}<p>{f"0 0 1 1 {corner} 2 " * triangles}</p></triangles>'
    vertices = '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
    mesh = f"<mesh>{source('p', '0 0 0 1 0 0 0 1 0')}{source('n', '0 0 1 ' * 3)}{vertices}{faces}</mesh>"
    nodes = '<instance_geometry url="#g"/>' * copies
    return (
        '<COLLADA version="1.4.1"><asset><unit meter="1"/></asset>'
        f'<library_geometries><geometry id="g">{mesh}</geometry></library_geometries>'
        f'<library_visual_scenes><visual_scene id="s"><node>{nodes}</node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


@pytest.mark.parametrize(
    ("name", "content", "limit", "reason"),
    [
        ("m.dae", collada(corner=2_000_000_000), {}, "PyBullet crashes on it"),
        ("m.dae", collada(copies=10_000, triangles=10_000), {"_TIMEOUT": 2.0}, "does not load it within 2 s"),
        ("m.obj", TRIANGLE + "f 1 2 2000000000\n", {}, "PyBullet crashes on it"),
        ("m.obj", TRIANGLE + "f 1 2 3\n" * 200_000, {"_MEMORY": 256}, "it takes more than 256 MB"),
        ("m.dae", collada(), {}, ""),
    ],
    ids=["missing corner", "copies", "missing corner of an obj", "memory", "good"],
)
def test_hostile_mesh_harms_a_separate_process_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: str, limit: dict[str, float], reason: str
) -> None:
    for key, value in limit.items():
        monkeypatch.setattr(load_test, key, value)
    (tmp_path / name).write_text(content)
    text = urdf(LINK.replace("m.obj", str(tmp_path / name)))
    error = load_test.load_error(tmp_path / "m.urdf", text, [tmp_path / name])
    assert reason in error and bool(reason) == bool(error)


def test_large_model_is_refused_before_it_is_read(tmp_path: Path) -> None:
    for name in ("m.obj", "m.urdf"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(10 << 40)
        with pytest.raises(ConfigurationError, match=rf"{name} has more than 100 MB"):
            find_model(str(tmp_path / name))
    with pytest.raises(ConfigurationError, match=r"m\.obj has more than 100 MB"):
        mesh_of(tmp_path / "m.urdf", "m.obj", lambda _: [])


def test_invalid_models_become_boxes(tmp_path: Path) -> None:
    (tmp_path / "broken.urdf").write_text("<robot")
    (tmp_path / "broken.obj").write_text("v 0 0\n")
    (tmp_path / "picture.png").touch()
    (tmp_path / "good.obj").write_text(TRIANGLE)
    (tmp_path / "good.stl").write_bytes(stl(*(0, 0, 1), *(0, 0, 0), *(1, 0, 0), *(0, 1, 0)))
    (tmp_path / "good.urdf").write_text(urdf(LINK.replace("m.obj", "good.obj").replace("</l", _MASS + "</l")))
    size = (0.1, 0.1, 0.1)
    models = {"t:B-1": "broken.urdf", "t:B-2": "broken.obj", "t:B-3": "picture.png", "t:B-4": "none.urdf"}
    models |= {"t:G-5": "good.obj", "t:G-6": "good.stl", "t:G-7": "good.urdf", "t:G-8": "duck.obj"}
    bodies = [
        BodySpec(eid, pose=at(0.0, float(n), 1.0), size=size, model=model, movable=True)
        for n, (eid, model) in enumerate(models.items())
    ]
    bodies.append(BodySpec("t:B-9", model="broken.urdf"))
    scene = SceneSpec(tuple(bodies), (), models=(str(tmp_path),))
    with World(scene) as world:
        assert {problem.element for problem in world.problems} == {"t:B-1", "t:B-2", "t:B-3", "t:B-4", "t:B-9"}
        assert {problem.file for problem in world.problems} == {"broken.urdf", "broken.obj", "picture.png", "none.urdf"}
        assert set(world.bodies) == set(models)
        assert world.pose_of("t:G-7").position == pytest.approx((0.0, 6.0, 1.0)), "of its root, not its centre of mass"
        world.step(240)
        assert world.pose_of("t:B-1").position[2] == pytest.approx(0.05, abs=0.01), "it fell, as a box"
        assert all(world.pose_of(eid).position[2] < 0.9 for eid in models)


_MASS = '<inertial><origin xyz="0.02 0 0"/><mass value="0.3"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial>'


@pytest.mark.parametrize(
    ("model", "arms", "mobile", "problems"),
    [
        (mobile_manipulator(), 1, True, []),
        (fixed_panda(), 1, False, []),
        (RobotSpec(ROBOT, "r", base=BaseSpec(BASE, "base", "none.urdf", size=(0.5, 0.5, 0.2))), 0, False, [BASE]),
        (RobotSpec(ROBOT, "r", arms=(ArmSpec(ARM, "arm", "none.urdf"),)), 0, False, [ARM]),
        (RobotSpec(ROBOT, "r", arms=(ArmSpec(ARM, "arm", "cube.urdf"),)), 0, False, [ARM]),
        (
            dataclasses.replace(mobile_manipulator(), pose=Pose((0.0, 0.0, 0.0), from_euler(0.3, 0.0, 0.5))),
            1,
            True,
            [ROBOT],
        ),
    ],
)
def test_robot_omits_invalid_models(model: RobotSpec, arms: int, mobile: bool, problems: list[str]) -> None:
    composed = merge_models(model)
    assert composed.mobile is mobile
    assert [problem.element for problem in composed.problems] == problems
    with World(SceneSpec((), (model,))) as world:
        robot = world.robots[ROBOT]
        assert len(robot.arms) == arms
        assert [problem.element for problem in world.problems] == problems
        world.step(10)
        assert robot.pose().position == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_iiwa_has_a_separate_gripper_model() -> None:
    gripper = GripperSpec(GRIPPER, "hand", "package://skiros2_sim/models/parallel_gripper.urdf")
    arm = ArmSpec(ARM, "iiwa", "kuka_iiwa/model.urdf", at(0.0, 0.0, 0.1), gripper)
    panda = dataclasses.replace(fixed_panda().arms[0], id="rparts:ArmDevice-9", pose=at(0.0, 1.0, 0.0), gripper=None)
    with World(SceneSpec((), (RobotSpec(ROBOT, "pair", IDENTITY, arms=(arm, panda)),))) as world:
        assert world.problems == []
        arms = world.robots[ROBOT].arms
        assert [len(a.joints) for a in arms.values()] == [7, 7]
        hand = arms[ARM].gripper
        assert hand is not None
        assert [j.name for j in hand.joints] == ["iiwa/hand/left_finger_joint", "iiwa/hand/right_finger_joint"]
        assert arms["rparts:ArmDevice-9"].gripper is None
        hand.drive(0.02)
        world.step(240)
        assert hand.width() == pytest.approx(0.02, abs=0.002)
        assert world.pose_of(GRIPPER) == arms[ARM].tool_pose()
        flange = world.robots[ROBOT].link_pose("iiwa/lbr_iiwa_link_7").position
        assert sum((a - b) ** 2 for a, b in zip(flange, hand.tool_pose().position, strict=True)) ** 0.5 > 0.1
