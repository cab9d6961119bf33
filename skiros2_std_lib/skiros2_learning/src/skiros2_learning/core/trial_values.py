"""The values of trials as samplers model them: warped, with their noise, and ranked by success."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial
from scipy.optimize import minimize_scalar
from scipy.stats import yeojohnson

from skiros2_learning.core.search_space import Array

#: Attribute of a trial whose values are means of repetitions: their number, and the variance of each value over them.
REPETITIONS = "repetitions"
#: Attribute of a trial with criteria of success: the share of its executions that met them.
SUCCESS_RATE = "success_rate"
#: Share of the variance of values up to which their known noise counts. Trials that end at their first failure have no
#: variance if they fail at once: that of successes and failures alone would hide the first success.
_NOISE_SHARE = 0.2
#: Repetitions that the variance of all trials counts for in that of one: a few equal ones do not mean certainty.
_SHRINKAGE = 3.0


def _succeeded(trials: Sequence[FrozenTrial]) -> npt.NDArray[np.bool_]:
    """Whether trials have succeeded at least once, shape (n,); true for those without criteria of success."""
    return np.array([each.user_attrs.get(SUCCESS_RATE, 1.0) > 0.0 for each in trials], dtype=bool)


def is_plateau(trials: Sequence[FrozenTrial]) -> bool:
    """Whether the values of trials do not show where to search: all objectives have one value everywhere, or one of
    them while no trial has succeeded; so has each constraint."""
    names = set.intersection(*(set(each.constraints) for each in trials))
    limits = [[each.constraints[name] for each in trials] for name in names]
    constant = [_is_constant(np.array(column)) for column in zip(*(each.values for each in trials), strict=True)]
    is_hidden = all(constant) or (any(constant) and not _succeeded(trials).any())
    return is_hidden and all(_is_constant(np.array(column)) for column in limits)


def _is_constant(values: Array) -> bool:
    return float(values.std()) < 1e-12 * max(1.0, float(np.abs(values).max()))


def warped_objectives(
    directions: Sequence[StudyDirection], trials: Sequence[FrozenTrial], success_is_rare: bool
) -> tuple[Array, Array]:
    """Returns the values of trials, to be minimised and warped to be closer to normal ones, and their standard errors,
    0 where these are not known; both of shape (n, m).

    :param success_is_rare: nothing but luck leads to the first success, as without priors: trials without success are
        at most as good as those with it, and the noise counts up to a share of the variance of the values.
    """
    signs = np.array([-1.0 if direction is StudyDirection.MAXIMIZE else 1.0 for direction in directions])
    values = np.array([each.values[: len(directions)] for each in trials]) * signs
    succeeded = _succeeded(trials)
    if success_is_rare and succeeded.any():
        values[~succeeded] = np.maximum(values[~succeeded], values[succeeded].max(axis=0))
    warped, slopes = map(np.column_stack, zip(*(_warped(column) for column in values.T), strict=True))
    errors = _standard_errors(trials, len(directions), 1 if success_is_rare else 2) * slopes
    if success_is_rare:
        noise = (errors**2).mean(axis=0)
        errors = errors * np.sqrt(np.minimum(1.0, _NOISE_SHARE * warped.var(axis=0) / np.maximum(noise, 1e-100)))
    return warped, errors


def _standard_errors(trials: Sequence[FrozenTrial], count: int, least: int) -> Array:
    """Returns the standard errors of the first values of trials, shape (n, count); 0 where they are not known.

    :param least: the repetitions from which on those of a trial are known.
    """
    unknown = (0, [0.0] * count)
    found = [each.user_attrs.get(REPETITIONS, unknown) for each in trials]
    found = [each if each[0] >= least else unknown for each in found]
    repetitions = np.array([[float(number)] for number, _ in found])
    variances = np.array([values[:count] for _, values in found], dtype=float)
    free = np.maximum(repetitions - 1.0, 0.0)
    common = (free * variances).sum(axis=0) / max(1.0, float(free.sum()))
    own = (_SHRINKAGE * common + free * variances) / (_SHRINKAGE + free)
    errors: Array = np.where(repetitions > 0.0, np.sqrt(own / np.maximum(repetitions, 1.0)), 0.0)
    return errors


def _warped(values: Array) -> tuple[Array, Array]:
    """Returns values that are closer to normal ones, in the same order (Yeo and Johnson, "A New Family of Power
    Transformations to Improve Normality or Symmetry", 2000), and the slope of this map at each."""
    if _is_constant(values):
        return values, np.ones_like(values)
    spread = float(values.std())
    normal = (values - values.mean()) / spread
    logs = float((np.sign(normal) * np.log1p(np.abs(normal))).sum())

    def cost(power: float) -> float:
        """Minus the log likelihood; that of SciPy takes ten times as long."""
        return 0.5 * len(normal) * math.log(yeojohnson(normal, power).var()) - (power - 1.0) * logs

    power, step = float(minimize_scalar(cost, bounds=(-3.0, 3.0), method="bounded").x), 1e-4
    warped: Array = yeojohnson(normal, power)
    slopes: Array = (yeojohnson(normal + step, power) - yeojohnson(normal - step, power)) / (2.0 * step * spread)
    return warped, slopes
