"""Functions with known optima, for optimisers."""

from __future__ import annotations

import math

import numpy as np
from optuna.trial import Trial

#: Of Hartmann's function of six variables: https://www.sfu.ca/~ssurjano/hart6.html
_SCALES = np.array(
    [[10, 3, 17, 3.5, 1.7, 8], [0.05, 10, 17, 0.1, 8, 14], [3, 3.5, 1.7, 10, 17, 8], [17, 8, 0.05, 10, 0.1, 14]]
)
_CENTRES = 1e-4 * np.array(
    [[1312, 1696, 5569, 124, 8283, 5886], [2329, 4135, 8307, 3736, 1004, 9991],
     [2348, 1451, 3522, 2883, 3047, 6650], [4047, 8828, 8732, 5743, 1091, 381]]
)  # fmt: skip
HARTMANN_OPTIMUM = (0.20169, 0.150011, 0.476874, 0.275332, 0.311652, 0.6573)
HARTMANN_MINIMUM, BRANIN_MINIMUM = -3.32237, 0.397887


def branin(trial: Trial) -> float:
    x, y = trial.suggest_float("x", -5.0, 10.0), trial.suggest_float("y", 0.0, 15.0)
    bowl = y - 5.1 / (4 * math.pi**2) * x**2 + 5 / math.pi * x - 6
    return bowl**2 + 10 * (1 - 1 / (8 * math.pi)) * math.cos(x) + 10


def hartmann(trial: Trial) -> float:
    x = np.array([trial.suggest_float(f"x{i}", 0.0, 1.0) for i in range(6)])
    return -float(np.array([1, 1.2, 3, 3.2]) @ np.exp(-(_SCALES * (x - _CENTRES) ** 2).sum(axis=1)))


def zdt1(trial: Trial) -> tuple[float, float]:
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
