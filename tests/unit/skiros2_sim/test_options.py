"""The parameters of the simulator node."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_sim.core.perception import Source
from skiros2_sim.ros.options import Options, read_options


def options(**parameters: Any) -> Options:
    return read_options(lambda name, default: parameters.get(name.lstrip("~"), default))


def test_default_rate_is_real_time() -> None:
    assert options() == Options()


def test_parameters_are_read() -> None:
    read = options(scene=" cell.ttl ", workspace="/here", seed=7, rate=0, paused=True, detection="truth", noise=0.002)
    assert (read.scene, read.workspace, read.seed, read.rate, read.paused) == ("cell.ttl", "/here", 7, 0.0, True)
    assert (read.detection, read.noise.position, read.noise.angle) == (Source.TRUTH, 0.002, 0.02)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate", -1.0),
        ("rate", float("nan")),
        ("rate", "fast"),
        ("rate", True),
        ("seed", -4),
        ("seed", 1.5),
        ("seed", 10**40),
        ("camera_rate", 1e9),
        ("noise", -0.5),
        ("position_noise", float("inf")),
        ("yaw_noise", 4.0),
        ("wrench_timeout", -1.0),
        ("detection", "guess"),
        ("detection", ["camera"]),
    ],
)
def test_invalid_parameter_is_named(name: str, value: Any) -> None:
    with pytest.raises(ConfigurationError, match=f"~{name} is .{{,60}}expected"):
        options(**{name: value})
