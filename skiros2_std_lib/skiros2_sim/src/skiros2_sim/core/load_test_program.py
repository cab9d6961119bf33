"""A program that loads models, fixed and free, and makes some steps; it imports only PyBullet.

Its arguments are the memory that it may use (MB) and the files. Its exit status is 0 on success; otherwise the last
line of stderr is the reason.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Sequence

import pybullet

_STEPS = 10
_MAX_SIZE = 1e5  # m


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
