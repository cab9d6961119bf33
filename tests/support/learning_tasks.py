"""Executions for tests of studies: functions of the configuration, and ones that break. Worker processes import
them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from skiros2_learning.core.episode_record import EpisodeRecord
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.variables import Value


def record(value: float, succeeded: bool = True) -> EpisodeRecord:
    """An execution with a series `value`."""
    nothing: dict[str, np.ndarray] = {}
    times = np.array([0.0, 1.0])
    return EpisodeRecord(succeeded, "" if succeeded else "failed", 1.0, times, nothing, nothing,
                         {"value": np.array([value, value])})  # fmt: skip


def parabola(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Best at x = 0.3, with noise that depends on seed and repetition."""
    noise = float(np.random.default_rng([seed, index]).normal(0.0, 0.001))
    return record((float(configuration["x"]) - 0.3) ** 2 + noise, succeeded=float(configuration["x"]) < 0.5)


def dies_once(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """The process is killed in its first evaluation ever; the file `died` in the settings' folder remembers it."""
    mark = Path(str(scenario.settings["folder"])) / "died"
    try:
        mark.touch(exist_ok=False)
    except FileExistsError:
        return parabola(scenario, configuration, seed, index)
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def always_dies(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """The process is killed."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def hangs(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Does not return. Writes the id of its process to the file `hanging` in the settings' folder."""
    mark = Path(str(scenario.settings["folder"])) / "hanging"
    mark.with_suffix(".new").write_text(str(os.getpid()))
    mark.with_suffix(".new").rename(mark)
    while True:
        time.sleep(1.0)


def raises(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Raises."""
    raise RuntimeError("the physics has exploded")


def not_a_number(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Gives a value that is not a number."""
    return record(float("nan"))


def waits_for_go(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Leaves a file with the id of its run in the settings' folder, and ends when the file `go` is there."""
    folder = Path(str(scenario.settings["folder"]))
    (folder / f"run-{os.getppid()}").touch()
    deadline = time.monotonic() + 400.0
    while not (folder / "go").exists():
        assert time.monotonic() < deadline, "nobody said go"
        time.sleep(0.01)
    return parabola(scenario, configuration, seed, index)


def bowl(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Best, with the value 0, at the point `best` of the settings; a success below 0.01."""
    best = scenario.settings["best"]
    value = sum((float(configuration[name]) - float(place)) ** 2 for name, place in best.items())
    return record(value, succeeded=value < 0.01)


def branches(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """The gait `trot` is better, with the best value 0 at y = 0.7, three turns and z = 4; y and z exist there only."""
    value = (float(configuration["x"]) - 0.3) ** 2
    if configuration["gait"] == "trot":
        turns = int(configuration["turns"])
        value += (float(configuration["y"]) - 0.7) ** 2 + 0.05 * (3 - turns)
        value += 0.01 * abs(int(configuration["z"]) - 4) if turns > 1 else 0.0
    else:
        value += 0.5
    return record(value, succeeded=value < 0.3)


def default_configuration(scenario: Scenario) -> Mapping[str, Value]:
    """The `defaults` of the settings; none without."""
    return dict(scenario.settings.get("defaults", {}))


def chance_rate(x: float) -> float:
    """The true rate of `chance`: 0.8 at x = 0.3, less elsewhere."""
    return max(0.05, 0.8 - 1.5 * abs(x - 0.3))


def chance(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Succeeds by chance, at a known rate; the value is x with normal noise of deviation 1. Each configuration has its
    own luck, as in physics."""
    x = float(configuration["x"])
    random = np.random.default_rng([seed, index, int(x * 1e9)])
    return record(x + float(random.normal()), succeeded=bool(random.random() < chance_rate(x)))


def moving_bowl(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """A bowl whose optimum is a function of the feature f, not a linear one."""
    x, y = moving_optimum(scenario.variation["f"])
    value = (float(configuration["x"]) - x) ** 2 + (float(configuration["y"]) - y) ** 2
    return record(value, succeeded=value < 0.005)


def moving_optimum(feature: float) -> tuple[float, float]:
    """The best x and y of `moving_bowl`."""
    return 0.2 + 0.6 * feature, 0.8 - 0.5 * feature**2
