"""Variants of the piston cell: other arms, other clearances and depths of the bores."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from skiros2_learning.local.insertion_study import ARM, SCENE
from skiros2_sim.core.scene_spec import GripperSpec, SceneSpec
from support.simulated_cell import GRIPPER, at, bench

#: A gripper of boxes with two fingers, for arms that come without one.
_GRIPPER = """<robot name="gripper">
  <link name="palm">
    <inertial>
      <origin xyz="0 0 0.03"/><mass value="0.5"/>
      <inertia ixx="8e-4" ixy="0" ixz="0" iyy="8e-4" iyz="0" izz="8e-4"/>
    </inertial>
    <visual><origin xyz="0 0 0.03"/><geometry><box size="0.06 0.1 0.06"/></geometry></visual>
    <collision><origin xyz="0 0 0.03"/><geometry><box size="0.06 0.1 0.06"/></geometry></collision>
  </link>
  <link name="tool"/>
  <joint name="tool" type="fixed"><parent link="palm"/><child link="tool"/><origin xyz="0 0 0.105"/></joint>
  {left}
  {right}
</robot>
"""
_FINGER = """<link name="{name}">
    <inertial>
      <origin xyz="0 {y} 0.03"/><mass value="0.05"/>
      <inertia ixx="2e-5" ixy="0" ixz="0" iyy="2e-5" iyz="0" izz="1e-5"/>
    </inertial>
    <visual><origin xyz="0 {y} 0.03"/><geometry><box size="0.02 0.014 0.06"/></geometry></visual>
    <collision><origin xyz="0 {y} 0.03"/><geometry><box size="0.02 0.014 0.06"/></geometry></collision>
  </link>
  <joint name="{name}_joint" type="prismatic">
    <parent link="palm"/><child link="{name}"/><origin xyz="0 0 0.058"/><axis xyz="0 {axis} 0"/>
    <limit lower="0" upper="0.04" effort="40" velocity="0.2"/>
  </joint>"""


@dataclass(frozen=True)
class ArmVariant:
    """An arm of `pybullet_data` in place of the right one.

    :param model: "" for the Panda of the scene.
    :param start: its start posture (rad), above the engine block.
    :param flange: height of the gripper's mount above its last link (m).
    """

    model: str = ""
    start: tuple[float, ...] = ()
    flange: float = 0.0


ARMS = {
    "panda": ArmVariant(),
    "iiwa": ArmVariant("kuka_iiwa/model.urdf", (0.0, 0.6, 0.0, -1.7, 0.0, 0.84, 0.0), 0.045),
    "xarm6": ArmVariant("xarm/xarm6_robot.urdf", (0.0, -0.2, -1.0, 0.0, 1.2, 0.0)),
}


def write_cell(folder: Path, arm: str = "panda", clearance: float = 0.0002, depth: float = 0.06) -> Path:
    """Writes a variant of the piston cell into a new folder. Returns its scene.

    :param arm: one of `ARMS`.
    :param clearance: difference of the diameters of the bores of the block and the piston (m).
    :param depth: of these bores (m).
    """
    shutil.copytree(SCENE.parent, folder)
    scene = folder / SCENE.name
    text = scene.read_text()
    text = text.replace('skiros:Diameter "0.0402"', f'skiros:Diameter "{0.04 + clearance:.5f}"')
    text = text.replace('skiros:Depth "0.06"', f'skiros:Depth "{depth:.4f}"')
    variant = ARMS[arm]
    if variant.model:
        text = _with_element(text, ARM, lambda element: _other_arm(element, variant))
        text = _with_element(text, "rparts:GripperEffector-5", lambda element: _own_gripper(element, variant))
        _write_gripper(folder)
    scene.write_text(text)
    return scene


def _write_gripper(folder: Path) -> Path:
    sides = (("left", 1), ("right", -1))
    fingers = {side: _FINGER.format(name=side, y=sign * 0.007, axis=sign) for side, sign in sides}
    gripper = folder / "gripper.urdf"
    gripper.write_text(_GRIPPER.format(**fingers))
    return gripper


def _with_element(text: str, eid: str, change: Callable[[str], str]) -> str:
    begin = text.index(f"\n{eid} a owl:NamedIndividual")
    end = text.index(" .\n\n", begin)
    return text[:begin] + change(text[begin:end]) + text[end:]


def _other_arm(element: str, variant: ArmVariant) -> str:
    joints = ", ".join(f'"joint{number}"' for number in range(1, len(variant.start) + 1))
    element = element.replace("franka_panda/panda.urdf", variant.model)
    # its fingers are rigid: the default for what is not known
    element = element.replace('skiros:ContactStiffness "600000.0"^^xsd:float ;', "")
    element = re.sub(r"skiros:JointNames '''.*?'''", f"skiros:JointNames '[{joints}]'", element, flags=re.S)
    start = ", ".join(map(str, variant.start))
    return re.sub(r"skiros:Postures '''.*?'''", f"""skiros:Postures '{{"start": [{start}]}}'""", element, flags=re.S)


def _own_gripper(element: str, variant: ArmVariant) -> str:
    element = re.sub(r'(skiros:Position[XYZ]|skiros:Orientation[XYZW]) "[^"]*"', r'\1 "0.0"', element)
    element = element.replace('skiros:OrientationW "0.0"', 'skiros:OrientationW "1.0"')
    element = element.replace('skiros:PositionZ "0.0"', f'skiros:PositionZ "{variant.flange}"')
    return element + ' ;\n    skiros:CadModel "gripper.urdf"'


def bench_of(arm: str, folder: Path) -> SceneSpec:
    """Returns the bench with another arm, whose gripper of boxes is written into a folder.

    :param arm: one of `ARMS` with a model.
    """
    variant, scene = ARMS[arm], bench()
    gripper = _write_gripper(folder)
    robot = scene.robots[0]
    own = GripperSpec(GRIPPER, "gripper", str(gripper), at(0.0, 0.0, variant.flange))
    other = replace(robot.arms[0], model=variant.model, postures={"start": variant.start}, gripper=own)
    return replace(scene, robots=(replace(robot, arms=(other,)),))
