"""Test-loads models in a separate process, since PyBullet may end the process on an invalid one.

As a program, this file loads models, fixed and free, and makes some steps; it imports only PyBullet. Its arguments are
the memory that it may use (MB) and the files. Its exit status is 0 on success; otherwise the last line of stderr is the
reason.
"""

from __future__ import annotations

import hashlib
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pybullet
import pybullet_data

_STEPS = 10
_TIMEOUT = 30.0  # s
_MEMORY = 2048  # MB
_MAX_SIZE = 1e5  # m
_DATA = Path(pybullet_data.getDataPath()).resolve()
_known: dict[tuple[str, str], str] = {}


def load_error(file: Path, text: str | None = None, meshes: Sequence[Path] = ()) -> str:
    """Returns why PyBullet cannot use a model; "" if it can. Results are cached; PyBullet's own models are not tested.

    :param file: the model.
    :param text: the URDF generated from it; None if PyBullet reads the file itself.
    :param meshes: the meshes of the URDF: PyBullet loads a URDF with a broken mesh without its shape.
    """
    if file.resolve().is_relative_to(_DATA):
        return ""
    hashed = hashlib.sha256(file.read_bytes() if text is None else text.encode())
    for mesh in meshes:
        hashed.update(mesh.read_bytes())
    key = (str(file), hashed.hexdigest())
    if key not in _known:
        _known[key] = _load_in_process(file, text, meshes)
    return _known[key]


def _load_in_process(file: Path, text: str | None, meshes: Sequence[Path]) -> str:
    with tempfile.TemporaryDirectory(prefix="skiros2_sim_") as folder:
        tried = file
        if text is not None:
            tried = Path(folder, "model.urdf")
            tried.write_text(text, encoding="utf-8")
        # -P: modules beside this file have names that others use too. Collada is only read within a URDF.
        command = [sys.executable, "-P", str(Path(__file__).resolve()), str(_MEMORY)]
        command += [str(mesh) for mesh in meshes if mesh.suffix.lower() != ".dae"]
        try:
            ended = subprocess.run([*command, str(tried)], capture_output=True, timeout=_TIMEOUT, check=False)
        except subprocess.TimeoutExpired:
            return f"PyBullet does not load it within {_TIMEOUT:.0f} s"
    if ended.returncode == 0:
        return ""
    if ended.returncode < 0:
        return f"PyBullet crashes on it, or it takes more than {_MEMORY} MB (signal {-ended.returncode})"
    errors = ended.stderr.decode(errors="replace").strip().splitlines()
    return f"PyBullet does not load {errors[-1].replace(str(tried), 'it') if errors else 'it'}"


def _main(memory: str, files: Sequence[str]) -> int:
    resource.setrlimit(resource.RLIMIT_AS, (int(memory) << 20,) * 2)
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, 0, -9.81)
    for file in files:
        for is_fixed in (True, False):
            try:
                _load(file, is_fixed)
            except (pybullet.error, ValueError) as error:
                sys.stderr.write(f"{file}: {error}\n")
                return 1
    pybullet.disconnect(client)
    return 0


def _load(file: str, is_fixed: bool) -> None:
    """Loads a model, makes some steps, and removes it.

    :raises ValueError: its size or its pose after the steps is not finite.
    """
    if file.lower().endswith(".urdf"):
        body = pybullet.loadURDF(file, useFixedBase=is_fixed)
    else:
        flags = pybullet.GEOM_FORCE_CONCAVE_TRIMESH if is_fixed else 0
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=file, flags=flags)
        seen = pybullet.createVisualShape(pybullet.GEOM_MESH, fileName=file)
        body = pybullet.createMultiBody(0.0 if is_fixed else 1.0, shape, seen)
        _, points = pybullet.getMeshData(body)
        if not all(abs(number) < _MAX_SIZE for point in points for number in point):
            raise ValueError(f"it has a vertex that is not finite or farther than {_MAX_SIZE:.0f} m")
    for _ in range(_STEPS):
        pybullet.stepSimulation()
    pybullet.getCameraImage(16, 16, renderer=pybullet.ER_TINY_RENDERER)
    position, orientation = pybullet.getBasePositionAndOrientation(body)
    if not all(abs(number) < _MAX_SIZE for number in (*position, *orientation)):
        raise ValueError("it has no finite pose after some steps")
    pybullet.removeBody(body)


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1], sys.argv[2:]))
