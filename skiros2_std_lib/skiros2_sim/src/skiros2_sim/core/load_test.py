"""Test-loads models in a separate process, since PyBullet may end the process on an invalid one."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pybullet_data

_TIMEOUT = 30.0  # s
_MEMORY = 2048  # MB
#: See there.
PROGRAM = Path(__file__).with_name("load_test_program.py").resolve()
#: The folder of the models that PyBullet brings along.
ENGINE_MODELS = Path(pybullet_data.getDataPath()).resolve()
_known: dict[tuple[str, str], str] = {}


def load_error(file: Path, text: str | None = None, meshes: Sequence[Path] = ()) -> str:
    """Returns why PyBullet cannot use a model; "" if it can. Results are cached; PyBullet's own models are not tested.

    :param file: the model.
    :param text: the URDF generated from it; None if PyBullet reads the file itself.
    :param meshes: the meshes of the URDF: PyBullet loads a URDF with a broken mesh without its shape.
    """
    if file.resolve().is_relative_to(ENGINE_MODELS):
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
        command = [sys.executable, "-P", str(PROGRAM), str(_MEMORY)]
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
