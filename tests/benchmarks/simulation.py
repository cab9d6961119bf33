"""The simulated cell of a mobile manipulator: what a second of its time costs, beside PyBullet that only steps the same
robot and boxes, and takes the same pictures, with nothing around it.

Figures are seconds for a simulated second: 0.2 is five times real time. Those in this process are CPU time: one thread
does it all.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pybullet
import pybullet_data

from benchmarks.measurement import Measurement, cpu_seconds, paired
from skiros2_sim.core.camera import picture_of
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.scene_spec import SceneSpec
from skiros2_sim.core.world import World
from support.ros import Ros

Clock = Callable[[], float]

RUNS = 5
#: Steps of a simulated second.
SECOND = 240
#: Pictures in a simulated second.
PICTURES = 5
#: At least 5 times real time without a camera, 2 times with one.
MOST, MOST_WITH_CAMERA = 0.2, 0.5

_PEER = "PyBullet alone, the same bodies"

ROOT = Path(__file__).resolve().parents[2]
OWL = ROOT / "skiros2_std_lib/demos/pick_and_place/owl"


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    yield from _measure_in_process()
    yield from _measure_node(ros, folder)


def _measure_in_process() -> Iterator[Measurement]:
    """The world alone, in this process."""
    scene = load_scene(OWL / "sim_scene.ttl", OWL)
    peer = _Bare(scene)
    with World(scene) as world:
        camera = next(iter(world.cameras))
        world.step(SECOND)  # things come to rest

        def with_pictures() -> None:
            for _ in range(PICTURES):
                world.step(SECOND // PICTURES)
                picture_of(world, camera)

        yield _beside(peer.step, "a simulated second of a mobile manipulator", lambda: world.step(SECOND), MOST)
        name = f"the same, with {PICTURES} pictures of 320 x 240"
        yield _beside(peer.step_with_pictures, name, with_pictures, MOST_WITH_CAMERA)
    peer.close()


def _measure_node(ros: Ros, folder: Path) -> Iterator[Measurement]:
    """The same by the simulator node, which publishes clock, joints, tf, odometry and what is subscribed."""
    from sensor_msgs.msg import Image

    from skiros2_sim_msgs.srv import Step

    scene = load_scene(OWL / "sim_scene.ttl", OWL)
    ros.launch("skiros2_sim", "sim.launch", scene="sim_scene.ttl", workspace_dir=OWL, paused=True, camera_rate=PICTURES)
    step = ros.service("/sim/step", Step)
    peer = _Bare(scene)
    step(steps=SECOND)
    pid = ros.master.node_pid("/sim")
    yield paired(  # depends less on other programs of the machine than the times below
        "CPU time of a simulated second of the node",
        lambda: _seconds_of(lambda: step(steps=SECOND), lambda: cpu_seconds(pid)),
        _PEER,
        lambda: _seconds_of(peer.step, time.thread_time),
        unit="s",
        runs=RUNS,
        limit=MOST,
    )
    for pictures in (0, PICTURES):
        if pictures:
            seen = ros.messages(scene.robots[0].cameras[0].rgb_topic, Image).connected()
            step(steps=SECOND)
            seen.wait_for()
        name = "a simulated second of the node" + (f", with {pictures} pictures" if pictures else "")
        bare = peer.step_with_pictures if pictures else peer.step
        limit = MOST_WITH_CAMERA if pictures else MOST
        yield _beside(bare, name, lambda: step(steps=SECOND), limit, time.perf_counter)
    peer.close()


def _beside(
    peer: Callable[[], object], name: str, ours: Callable[[], object], limit: float, clock: Clock = time.thread_time
) -> Measurement:
    return paired(
        name,
        lambda: _seconds_of(ours, clock),
        _PEER,
        lambda: _seconds_of(peer, clock),
        unit="s",
        runs=RUNS,
        limit=limit,
    )


def _seconds_of(call: Callable[[], object], clock: Clock) -> float:
    start = clock()
    call()
    return clock() - start


class _Bare:
    """A Panda on a Husky and the boxes of the scene, loaded as PyBullet's examples do, and nothing else."""

    def __init__(self, scene: SceneSpec) -> None:
        with _quiet():
            self._client = pybullet.connect(pybullet.DIRECT)
            pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=self._client)
            self._load("husky/husky.urdf", (0.0, 0.0, 0.15))
            self._load("franka_panda/panda.urdf", (0.3, 0.0, 0.5), useFixedBase=True)
        self._box((50.0, 50.0, 0.1), 0.0, (0.0, 0.0, -0.05))
        for body in scene.bodies:
            if body.size is not None:
                self._box(body.size, 0.2 if body.movable else 0.0, *body.pose)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        self.step()

    def step(self) -> None:
        for _ in range(SECOND):
            pybullet.stepSimulation(physicsClientId=self._client)

    def step_with_pictures(self) -> None:
        """Pictures as `getCameraImage` makes them by itself."""
        eye = pybullet.computeViewMatrix((0.7, 0.0, 1.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
        lens = pybullet.computeProjectionMatrixFOV(60.0, 320 / 240, 0.02, 20.0)
        for _ in range(PICTURES):
            for _ in range(SECOND // PICTURES):
                pybullet.stepSimulation(physicsClientId=self._client)
            pybullet.getCameraImage(320, 240, eye, lens, physicsClientId=self._client)

    def close(self) -> None:
        pybullet.disconnect(physicsClientId=self._client)

    def _load(self, model: str, position: tuple[float, float, float], **how: bool) -> None:
        pybullet.loadURDF(model, position, physicsClientId=self._client, **how)

    def _box(self, size: tuple[float, float, float], mass: float, *pose: tuple[float, ...]) -> None:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=[edge / 2 for edge in size], physicsClientId=self._client
        )
        seen = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=[edge / 2 for edge in size], physicsClientId=self._client
        )
        pybullet.createMultiBody(mass, shape, seen, *pose, physicsClientId=self._client)


@contextmanager
def _quiet() -> Iterator[None]:
    """Drops what PyBullet prints about models."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
