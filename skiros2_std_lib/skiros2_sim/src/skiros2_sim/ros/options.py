"""The private parameters of the simulator's node."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import ConfigurationError, SkirosError
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
    seed = _number(get, "~seed", 0, _HIGHEST_SEED)
    if seed != int(seed):
        raise ConfigurationError(f"parameter ~seed is {seed}, expected a whole number")
    kinds = [source.value for source in Source]
    detection = get("~detection", Source.CAMERA.value)
    if detection not in kinds:
        raise ConfigurationError(f"parameter ~detection is {detection!r}, expected {' or '.join(kinds)}")
    step_rate = _number(get, "~step_rate", STEP_RATE, MAX_STEP_RATE, MIN_STEP_RATE)
    if step_rate != int(step_rate):
        raise ConfigurationError(f"parameter ~step_rate is {step_rate}, expected a whole number")
    metres = _number(get, "~noise", 0.0, 1.0)
    return Options(
        scene=str(get("~scene", "")).strip(),
        workspace=str(get("~workspace", "")).strip(),
        seed=int(seed),
        rate=_number(get, "~rate", 1.0, MAX_RATE),
        paused=bool(get("~paused", False)),
        gui=bool(get("~gui", False)),
        camera_rate=_number(get, "~camera_rate", CAMERA_RATE, step_rate),
        depth_noise=_number(get, "~depth_noise", 0.0, 0.1),
        detection=Source(detection),
        noise=Noise(depth=metres, position=metres, angle=10 * metres),
        position_noise=_number(get, "~position_noise", 0.0, 1.0),
        yaw_noise=_number(get, "~yaw_noise", 0.0, math.pi),
        step_rate=int(step_rate),
        wrench_timeout=_number(get, "~wrench_timeout", WRENCH_TIMEOUT, 3600.0),
        sensor=_sensor(get),
    )


def _sensor(get: Callable[[str, Any], Any]) -> SensorModel:
    force, torque, bias = get("~force_noise", 0.0), get("~torque_noise", 0.0), get("~wrench_bias", [0.0] * 6)
    try:
        return SensorModel(force, torque, tuple(finite(bias, 6, "bias")))
    except (TypeError, SkirosError) as error:
        raise ConfigurationError(f"parameters ~force_noise, ~torque_noise, ~wrench_bias: {error}") from None


def _number(get: Callable[[str, Any], Any], name: str, default: float, most: float, least: float = 0.0) -> float:
    value = get(name, default)
    if not isinstance(value, int | float) or isinstance(value, bool) or math.isnan(value) or not least <= value <= most:
        raise ConfigurationError(f"parameter {name} is {value!s:.40}, expected a number, {least:g} to {most:g}")
    return float(value)
