"""The private parameters of the simulator's node."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from skiros2_common.core.errors import ConfigurationError, SkirosError
from skiros2_common.ros.parameters import integer_param, number_param
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.perception import EXACT, Noise, Source
from skiros2_sim.core.stepper import MAX_RATE
from skiros2_sim.core.world import MAX_RATE as MAX_STEP_RATE
from skiros2_sim.core.world import MIN_RATE as MIN_STEP_RATE
from skiros2_sim.core.world import RATE as STEP_RATE
from skiros2_sim.core.wrist_sensor import EXACT as EXACT_SENSOR
from skiros2_sim.core.wrist_sensor import SensorModel

#: Default rate of images of cameras with subscribers, Hz of simulated time.
CAMERA_RATE = 5.0
#: Default time after which a commanded wrench becomes 0 (s).
WRENCH_TIMEOUT = 1.0
_HIGHEST_SEED = 2**53


@dataclass(frozen=True)
class Options:
    """The parameters of the simulator node.

    :param scene: file in the workspace; "" for an empty world.
    :param workspace: folder of the user's ontologies, scenes and models; "" for that of the platform's ontologies.
    :param seed: of all random numbers.
    :param rate: times real time; 0 for the maximum.
    :param paused: whether time is stopped initially.
    :param gui: whether to show PyBullet's window.
    :param camera_rate: Hz of simulated time; 0 for no images on topics.
    :param depth_noise: standard deviation of the depth of each pixel in images on topics (m).
    :param detection: source of poses in perception.
    :param noise: of perception.
    :param position_noise: maximum offset of movable bodies at the start (m).
    :param yaw_noise: maximum rotation of movable bodies at the start (rad).
    :param step_rate: steps per second of simulated time.
    :param wrench_timeout: time (s) after which a commanded wrench becomes 0; 0 for never.
    :param sensor: errors of the force/torque sensors at the wrists.
    """

    scene: str = ""
    workspace: str = ""
    seed: int = 0
    rate: float = 1.0
    paused: bool = False
    gui: bool = False
    camera_rate: float = CAMERA_RATE
    depth_noise: float = 0.0
    detection: Source = Source.CAMERA
    noise: Noise = EXACT
    position_noise: float = 0.0
    yaw_noise: float = 0.0
    step_rate: int = STEP_RATE
    wrench_timeout: float = WRENCH_TIMEOUT
    sensor: SensorModel = EXACT_SENSOR


def read_options(get: Callable[[str, Any], Any]) -> Options:
    """Reads and checks the parameters.

    :param get: returns a parameter, or a default, like `rospy.get_param`.
    :raises ConfigurationError: a parameter is invalid.
    """
    number, integer = partial(number_param, minimum=0.0, get=get), partial(integer_param, get=get)
    kinds = [source.value for source in Source]
    detection = get("~detection", Source.CAMERA.value)
    if detection not in kinds:
        raise ConfigurationError(f"parameter ~detection is {detection!r}, expected {' or '.join(kinds)}")
    step_rate = integer("~step_rate", STEP_RATE, minimum=MIN_STEP_RATE, maximum=MAX_STEP_RATE)
    metres = number("~noise", 0.0, maximum=1.0)
    return Options(
        scene=str(get("~scene", "")).strip(),
        workspace=str(get("~workspace", "")).strip(),
        seed=integer("~seed", 0, minimum=0, maximum=_HIGHEST_SEED),
        rate=number("~rate", 1.0, maximum=MAX_RATE),
        paused=bool(get("~paused", False)),
        gui=bool(get("~gui", False)),
        camera_rate=number("~camera_rate", CAMERA_RATE, maximum=step_rate),
        depth_noise=number("~depth_noise", 0.0, maximum=0.1),
        detection=Source(detection),
        noise=Noise(depth=metres, position=metres, angle=10 * metres),
        position_noise=number("~position_noise", 0.0, maximum=1.0),
        yaw_noise=number("~yaw_noise", 0.0, maximum=math.pi),
        step_rate=step_rate,
        wrench_timeout=number("~wrench_timeout", WRENCH_TIMEOUT, maximum=3600.0),
        sensor=_sensor(get),
    )


def _sensor(get: Callable[[str, Any], Any]) -> SensorModel:
    force, torque, bias = get("~force_noise", 0.0), get("~torque_noise", 0.0), get("~wrench_bias", [0.0] * 6)
    try:
        return SensorModel(force, torque, tuple(finite(bias, 6, "bias")))
    except (TypeError, SkirosError) as error:
        raise ConfigurationError(f"parameters ~force_noise, ~torque_noise, ~wrench_bias: {error}") from None
