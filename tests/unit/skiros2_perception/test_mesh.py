"""Shapes of CAD models: files, samples, and the pose of an object with a model in simulated depth images."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, from_euler
from skiros2_perception.core.mesh import mesh_shape, read_triangles
from skiros2_perception.core.pose_estimation import estimate_pose
from skiros2_perception.core.transforms import difference
from skiros2_sim.core.scene_spec import BodySpec
from skiros2_sim.core.world import World
from support import depth_scene as scene

#: An L-shaped bracket: its profile (m), the depth along y, and its volume (m^3). The origin is at a lower corner.
PROFILE = ((0.0, 0.0), (0.16, 0.0), (0.16, 0.03), (0.04, 0.03), (0.04, 0.1), (0.0, 0.1))
DEPTH, SIZE = 0.09, (0.16, 0.09, 0.1)
#: The profile as convex parts.
PARTS = (((0.0, 0.04), (0.0, 0.1)), ((0.04, 0.16), (0.0, 0.03)))


def bracket_obj(scale: float = 1.0, inwards: bool = False) -> str:
    """The bracket as an OBJ with polygons."""
    front = [(x, 0.0, z) for x, z in PROFILE]
    back = [(x, DEPTH, z) for x, z in PROFILE]
    count = len(PROFILE)
    faces = [[i + 1, (i + 1) % count + 1, (i + 1) % count + 1 + count, i + 1 + count] for i in range(count)]
    # fans from the inner corner are inside of the profile
    faces += [[4, 3, 2, 1, 6, 5], [i + count for i in (4, 5, 6, 1, 2, 3)]]
    if not inwards:
        faces = [[face[0], *face[:0:-1]] for face in faces]
    lines = [f"v {scale * x} {scale * y} {scale * z}" for x, y, z in front + back]
    return "\n".join([*lines, *("f " + " ".join(f"{i}//1" for i in face) for face in faces)])


def signed_volume(triangles: np.ndarray) -> float:
    a, b, c = (triangles[:, i] for i in range(3))
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6)


def as_binary_stl(triangles: np.ndarray) -> bytes:
    data = b"solid of a program that begins its binary files like this".ljust(80) + len(triangles).to_bytes(4, "little")
    for corners in triangles:
        data += np.array((0.0, 0.0, 0.0, *corners.ravel()), "<f4").tobytes() + b"\0\0"
    return data


def as_text_stl(triangles: np.ndarray) -> bytes:
    lines = ["solid bracket"]
    for corners in triangles:
        lines += ["facet normal 0 0 0", "outer loop", *("vertex {} {} {}".format(*corner) for corner in corners)]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid"]).encode()


@pytest.fixture
def bracket(tmp_path: Path) -> Path:
    file = tmp_path / "bracket.obj"
    file.write_text(bracket_obj())
    return file


def test_polygons_become_triangles(bracket: Path) -> None:
    triangles = read_triangles(bracket)
    assert len(triangles) == 2 * len(PROFILE) + 2 * (len(PROFILE) - 2)
    assert abs(signed_volume(triangles)) == pytest.approx((0.04 * 0.1 + 0.12 * 0.03) * DEPTH)


@pytest.mark.parametrize("write", [as_binary_stl, as_text_stl])
def test_stl_files_have_the_same_triangles(bracket: Path, write: Callable[[np.ndarray], bytes]) -> None:
    triangles = read_triangles(bracket)
    file = bracket.with_suffix(".STL")
    file.write_bytes(write(triangles))
    assert read_triangles(file) == pytest.approx(triangles, abs=1e-7)


@pytest.mark.parametrize("inwards", [False, True])
def test_samples_are_on_the_surface_with_normals_outwards(bracket: Path, inwards: bool) -> None:
    bracket.write_text(bracket_obj(inwards=inwards))
    shape = mesh_shape(bracket)
    assert shape.size == pytest.approx(SIZE)
    assert np.linalg.norm(shape.normals, axis=1) == pytest.approx(1.0)
    assert not inside(shape.points + 1e-4 * shape.normals).any()
    assert inside(shape.points - 1e-4 * shape.normals).mean() > 0.99  # near edges it may be outside of another face
    assert len(shape.points) == pytest.approx(sum_of_areas() / 0.002**2, rel=0.01)


def inside(points: np.ndarray) -> np.ndarray:
    found = np.zeros(len(points), bool)
    for (x0, x1), (z0, z1) in PARTS:
        x, y, z = points.T
        found |= (x > x0) & (x < x1) & (z > z0) & (z < z1) & (y > 0) & (y < DEPTH)
    return found


def sum_of_areas() -> float:
    around = sum(math.dist(a, b) for a, b in zip(PROFILE, (*PROFILE[1:], PROFILE[0]), strict=True))
    return around * DEPTH + 2 * (0.04 * 0.1 + 0.12 * 0.03)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.dae", "", "expected one of .obj, .stl"),
        ("a.obj", "v 0 0\nf 1 2 3", "expected a mesh"),
        ("a.obj", "v 0 0 0\nf 1 2 3", "expected a mesh"),
        ("a.obj", "v 0 0 0", "no triangles"),
        ("a.stl", "solid\nvertex 1 2", "expected a mesh"),
        ("a.stl", "\x00\x01", "no triangles"),
        ("a.obj", bracket_obj(1000.0), "expected edges of 0.001 to 100 m"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0.1\nf 1 2 3", "expected a closed surface"),
        ("a.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0.1\nf 1 2 3", "expected edges"),
    ],
)
def test_unusable_model_is_refused_with_its_file(tmp_path: Path, name: str, content: str, reason: str) -> None:
    file = tmp_path / name
    file.write_text(content)
    with pytest.raises(WrongValue, match=reason) as raised:
        mesh_shape(file)
    assert str(file) in str(raised.value)


def test_missing_model_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WrongValue, match="No such file"):
        mesh_shape(tmp_path / "missing.stl")


@pytest.mark.parametrize("seed", range(3))
def test_object_with_a_model_is_located(bracket: Path, seed: int) -> None:
    expected = Pose((0.42, -0.045, scene.TOP), (0.0, 0.0, 0.0, 1.0))
    random = np.random.default_rng(seed)
    x, y = random.uniform(-0.01, 0.01, 2)
    true = Pose((0.42 + x, -0.045 + y, scene.TOP), from_euler(0.0, 0.0, float(random.uniform(-0.1, 0.1))))
    body = BodySpec(scene.PART, "skiros:Product", pose=true, size=SIZE, model=str(bracket))
    with World(scene.table(body)) as world:
        views = [scene.take(world, eye, random) for eye in scene.EYES]
    estimate = estimate_pose(mesh_shape(bracket), views, scene.SENSOR, expected)
    error = difference(estimate.pose, true)
    assert np.linalg.norm(error[:3]) < 0.0008
    assert np.linalg.norm(error[3:]) < math.radians(0.3)
    assert estimate.fitness > 0.9
