"""Test-loads a model in a separate process, since PyBullet may end the process on an invalid one.

As a program, this file loads a model, fixed and free, and makes some steps; it imports only PyBullet. Its exit status
is 0 on success; otherwise the last line of stderr is the reason.
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
_TIMEOUT = 30.0  # s
_DATA = Path(pybullet_data.getDataPath()).resolve()
_known: dict[tuple[str, str], str] = {}


def load_error(file: Path, text: str | None = None) -> str:
    """Returns why PyBullet cannot use a model; "" if it can. Results are cached; PyBullet's own models are not tested.

    :param file: the model.
    :param text: the URDF generated from it; None if PyBullet reads the file itself.
    """
    if file.resolve().is_relative_to(_DATA):
        return ""
    content = file.read_bytes() if text is None else text.encode()
    key = (str(file), hashlib.sha256(content).hexdigest())
    if key not in _known:
        _known[key] = _load_in_process(file, text)
    return _known[key]


def _load_in_process(file: Path, text: str | None) -> str:
    with tempfile.TemporaryDirectory(prefix="skiros2_sim_") as folder:
        tried = file
        if text is not None:
            tried = Path(folder, "model.urdf")
            tried.write_text(text, encoding="utf-8")
        # -P: modules beside this file have names that others use too.
        command = [sys.executable, "-P", str(Path(__file__).resolve()), str(tried)]
        try:
            ended = subprocess.run(command, capture_output=True, timeout=_TIMEOUT, check=False)
        except subprocess.TimeoutExpired:
            return f"PyBullet does not get done with it within {_TIMEOUT:.0f} s"
    if ended.returncode == 0:
        return ""
    if ended.returncode < 0:
        return f"PyBullet crashes on it (signal {-ended.returncode})"
    errors = ended.stderr.decode(errors="replace").strip().splitlines()
    return f"PyBullet does not load it: {errors[-1] if errors else 'no reason given'}"


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
