"""A cell with a Panda, a camera on its hand, an engine block and a cube on a table."""

from __future__ import annotations

from support.ros import ROOT

SCENE = ROOT / "tests/libraries/perception_cell/perception_scene.ttl"
CAMERA, BLOCK, CUBE = "skiros:DepthCamera-5", "skiros:Product-7", "skiros:Product-8"
#: rad, as in the scene.
POSTURES = {
    "home": (0.0, -0.9, 0.0, -2.1, 0.0, 1.4, 0.785),
    "left": (-0.127, -0.324, 0.832, -2.169, -0.499, 1.636, 0.805),
    "right": (0.126, -0.324, -0.832, -2.169, 0.499, 1.636, 0.766),
}
