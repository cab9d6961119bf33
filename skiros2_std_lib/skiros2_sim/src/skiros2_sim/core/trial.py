"""Loads a model in a process of its own, since PyBullet may end the process on one that is broken in a new way.

Run as a program it loads the file that it is given, once fixed and once free, and makes some steps; it needs PyBullet
alone. Its exit status is 0 when all went well; else the last line of the standard error tells what did not.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

import pybullet
import pybullet_data

_STEPS = 10
_PATIENCE = 30.0  # s
_DATA = Path(pybullet_data.getDataPath()).resolve()
_known: dict[tuple[str, str], str] = {}


def fault_of(file: Path, text: str | None = None) -> str:
    """Why PyBullet cannot use a model; "" when it can. PyBullet's own models are not tried; others once.

    :param file: the model.
    :param text: the URDF that is made of it; None: PyBullet reads the file.
    """
    if file.resolve().is_relative_to(_DATA):
        return ""
    content = file.read_bytes() if text is None else text.encode()
    key = (str(file), hashlib.sha256(content).hexdigest())
    if key not in _known:
        _known[key] = _tried(file, text)
    return _known[key]


def _tried(file: Path, text: str | None) -> str:
    with tempfile.TemporaryDirectory(prefix="skiros2_sim_") as folder:
        tried = file
        if text is not None:
            tried = Path(folder, "model.urdf")
            tried.write_text(text, encoding="utf-8")
        # -P: beside this file are modules whose names others have too.
        command = [sys.executable, "-P", str(Path(__file__).resolve()), str(tried)]
        try:
            ended = subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            return f"PyBullet does not get done with it within {_PATIENCE:.0f} s"
    if ended.returncode == 0:
        return ""
    if ended.returncode < 0:
        return f"PyBullet crashes on it (signal {-ended.returncode})"
    told = ended.stderr.decode(errors="replace").strip().splitlines()
    return f"PyBullet does not load it: {told[-1] if told else 'no reason given'}"


def _main(file: str) -> int:
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, 0, -9.81)
    for is_fixed in (True, False):
        if file.lower().endswith(".urdf"):
            body = pybullet.loadURDF(file, useFixedBase=is_fixed)
        else:
            flags = pybullet.GEOM_FORCE_CONCAVE_TRIMESH if is_fixed else 0
            shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=file, flags=flags)
            seen = pybullet.createVisualShape(pybullet.GEOM_MESH, fileName=file)
            body = pybullet.createMultiBody(0.0 if is_fixed else 1.0, shape, seen)
        for _ in range(_STEPS):
            pybullet.stepSimulation()
        pybullet.getCameraImage(16, 16, renderer=pybullet.ER_TINY_RENDERER)
        position, orientation = pybullet.getBasePositionAndOrientation(body)
        if not all(abs(number) < 1e6 for number in (*position, *orientation)):
            sys.stderr.write("it has no finite pose after some steps\n")
            return 1
        pybullet.removeBody(body)
    pybullet.disconnect(client)
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1]))
