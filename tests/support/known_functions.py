"""Functions with known optima, for optimisers."""

from __future__ import annotations

import math

import numpy as np
from optuna.trial import BaseTrial

#: Of Hartmann's function of six variables: https://www.sfu.ca/~ssurjano/hart6.html
_SCALES = np.array(
    [[10, 3, 17, 3.5, 1.7, 8], [0.05, 10, 17, 0.1, 8, 14], [3, 3.5, 1.7, 10, 17, 8], [17, 8, 0.05, 10, 0.1, 14]]
)
_CENTRES = 1e-4 * np.array(
    [[1312, 1696, 5569, 124, 8283, 5886], [2329, 4135, 8307, 3736, 1004, 9991],
     [2348, 1451, 3522, 2883, 3047, 6650], [4047, 8828, 8732, 5743, 1091, 381]]
)  # fmt: skip
HARTMANN_OPTIMUM = (0.20169, 0.150011, 0.476874, 0.275332, 0.311652, 0.6573)
HARTMANN_MINIMUM, BRANIN_MINIMUM, PRESSURE_VESSEL_MINIMUM = -3.32237, 0.397887, 6059.714335


def branin(trial: BaseTrial) -> float:
    x, y = trial.suggest_float("x", -5.0, 10.0), trial.suggest_float("y", 0.0, 15.0)
    bowl = y - 5.1 / (4 * math.pi**2) * x**2 + 5 / math.pi * x - 6
    return bowl**2 + 10 * (1 - 1 / (8 * math.pi)) * math.cos(x) + 10


def hartmann(trial: BaseTrial) -> float:
    x = np.array([trial.suggest_float(f"x{i}", 0.0, 1.0) for i in range(6)])
    return -float(np.array([1, 1.2, 3, 3.2]) @ np.exp(-(_SCALES * (x - _CENTRES) ** 2).sum(axis=1)))


def ackley(trial: BaseTrial) -> float:
    """Five variables; minimum 0 where all are 0. https://www.sfu.ca/~ssurjano/ackley.html"""
    x = _reals(trial, 5, -10.0, 15.0)
    waves = math.exp(float(np.cos(2.0 * math.pi * x).mean()))
    return 20.0 + math.e - 20.0 * math.exp(-0.2 * math.sqrt(float((x**2).mean()))) - waves


def levy(trial: BaseTrial) -> float:
    """Four variables; minimum 0 where all are 1. https://www.sfu.ca/~ssurjano/levy.html"""
    w = 1.0 + (_reals(trial, 4, -10.0, 10.0) - 1.0) / 4.0
    middle = float(((w[:-1] - 1.0) ** 2 * (1.0 + 10.0 * np.sin(math.pi * w[:-1] + 1.0) ** 2)).sum())
    last = (w[-1] - 1.0) ** 2 * (1.0 + math.sin(2.0 * math.pi * w[-1]) ** 2)
    return math.sin(math.pi * w[0]) ** 2 + middle + float(last)


def rosenbrock(trial: BaseTrial) -> float:
    """Three variables; minimum 0 where all are 1. https://www.sfu.ca/~ssurjano/rosen.html"""
    x = _reals(trial, 3, -5.0, 10.0)
    return float((100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (x[:-1] - 1.0) ** 2).sum())


def mixed(trial: BaseTrial) -> float:
    """Two reals, an integer and a choice, which depend on each other; minimum 0 at 0.7, 0.25, 6 and spiral."""
    x, y = trial.suggest_float("x", 0.0, 1.0), trial.suggest_float("y", 0.0, 1.0)
    count = trial.suggest_int("count", 1, 9)
    pattern = trial.suggest_categorical("pattern", ["line", "spiral", "zigzag", "star"])
    cost, best = {"line": (0.3, 0.2), "spiral": (0.0, 0.7), "zigzag": (0.1, 0.6), "star": (0.2, 0.9)}[pattern]
    return cost + (x - best) ** 2 + (y - 0.05 * count + 0.05) ** 2 + 0.02 * abs(count - 6)


def pressure_vessel(trial: BaseTrial) -> float:
    """The cost of a vessel: two thicknesses in steps, two reals, three constraints (Kannan and Kramer, "An Augmented
    Lagrange Multiplier Based Method for Mixed Integer Discrete Continuous Optimization", 1994)."""
    shell, head = (trial.suggest_int(name, 1, 99) / 16.0 for name in ("shell", "head"))
    radius, length = trial.suggest_float("radius", 10.0, 200.0), trial.suggest_float("length", 10.0, 200.0)
    trial.set_constraint("shell", 0.0193 * radius - shell)
    trial.set_constraint("head", 0.00954 * radius - head)
    trial.set_constraint("volume", 1.0 - math.pi * radius**2 * (length + 4.0 / 3.0 * radius) / 1_296_000.0)
    sheets = 0.6224 * shell * radius * length + 1.7781 * head * radius**2
    return sheets + shell**2 * (3.1661 * length + 19.84 * radius)


def zdt2(trial: BaseTrial) -> tuple[float, float]:
    """Two objectives, four variables; a front that is not convex."""
    x = _reals(trial, 4, 0.0, 1.0)
    g = 1 + 9 * float(x[1:].mean())
    return float(x[0]), g * (1 - (float(x[0]) / g) ** 2)


def dtlz2(trial: BaseTrial) -> tuple[float, float]:
    """Two objectives, five variables; the front is a quarter of a circle."""
    x = _reals(trial, 5, 0.0, 1.0)
    radius, angle = 1.0 + float(((x[1:] - 0.5) ** 2).sum()), 0.5 * math.pi * float(x[0])
    return radius * math.cos(angle), radius * math.sin(angle)


def branin_currin(trial: BaseTrial) -> tuple[float, float]:
    """Two objectives, two variables."""
    x, y = trial.suggest_float("x", -5.0, 10.0), trial.suggest_float("y", 0.0, 15.0)
    u, v = (x + 5.0) / 15.0, max(y / 15.0, 1e-9)
    shape = (2300.0 * u**3 + 1900.0 * u**2 + 2092.0 * u + 60.0) / (100.0 * u**3 + 500.0 * u**2 + 4.0 * u + 20.0)
    return branin(trial), (1.0 - math.exp(-0.5 / v)) * shape


def _reals(trial: BaseTrial, count: int, low: float, high: float) -> np.ndarray:
    return np.array([trial.suggest_float(f"x{i}", low, high) for i in range(count)])


def zdt1(trial: BaseTrial) -> tuple[float, float]:
    x = np.array([trial.suggest_float(f"x{i}", 0.0, 1.0) for i in range(4)])
    g = 1 + 9 * float(x[1:].mean())
    return float(x[0]), g * (1 - math.sqrt(float(x[0]) / g))


def dominated_area(front: list[tuple[float, ...]], corner: tuple[float, float] = (1.1, 5.0)) -> float:
    """The hypervolume of two objectives that are minimised."""
    area, last = 0.0, corner[1]
    for x, y in sorted(front):
        if x < corner[0] and y < last:
            area += (corner[0] - x) * (last - y)
            last = y
    return area
