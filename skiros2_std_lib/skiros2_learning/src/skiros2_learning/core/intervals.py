"""Confidence intervals of success shares and means, and tests of paired samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist, fmean, stdev

from scipy.special import stdtrit

LEVEL = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence interval. Without enough values the bounds are infinite."""

    estimate: float
    low: float
    high: float


def share_interval(good: int, count: int, level: float = LEVEL) -> Interval:
    """Returns a share with Wilson's score interval (Wilson, 1927); 0 to 1 if `count` is 0."""
    if not count:
        return Interval(0.0, 0.0, 1.0)
    z = NormalDist().inv_cdf((1.0 + level) / 2.0)
    share, weight = good / count, 1.0 + z * z / count
    middle = (share + z * z / (2.0 * count)) / weight
    half = z * math.sqrt(share * (1.0 - share) / count + z * z / (4.0 * count * count)) / weight
    return Interval(share, max(0.0, min(share, middle - half)), min(1.0, max(share, middle + half)))


def mean_interval(values: Sequence[float], level: float = LEVEL) -> Interval:
    """Returns a mean with Student's t interval, or, if all values are 0 or 1, a share with Wilson's."""
    if values and set(values) <= {0.0, 1.0}:
        return share_interval(round(sum(values)), len(values), level)
    return _t_interval(values, level)


def difference_interval(ones: Sequence[float], others: Sequence[float], level: float = LEVEL) -> Interval:
    """Returns the mean of `ones` minus `others`, pair by pair, with Student's t interval."""
    return _t_interval([one - other for one, other in zip(ones, others, strict=True)], level)


def difference_sign(ones: Sequence[float], others: Sequence[float], level: float = LEVEL) -> int:
    """Returns 1 if `ones` are larger with confidence, -1 if they are smaller, else 0; the samples are paired.

    Values that are all 0 or 1 are compared by the exact test of McNemar, others by the t interval of their difference.
    """
    if set(ones) | set(others) <= {0.0, 1.0}:
        pairs = list(zip(ones, others, strict=True))
        more, less = sum(a > b for a, b in pairs), sum(a < b for a, b in pairs)
        count, larger = more + less, max(more, less)
        chance = sum(math.comb(count, each) for each in range(larger, count + 1)) / 2.0**count
        return 0 if more == less or chance > (1.0 - level) / 2.0 else 1 if more > less else -1
    found = difference_interval(ones, others, level)
    return 1 if found.low > 0.0 else -1 if found.high < 0.0 else 0


def _t_interval(values: Sequence[float], level: float) -> Interval:
    if len(values) < 2:
        return Interval(values[0] if values else 0.0, -math.inf, math.inf)
    mean, count = fmean(values), len(values)
    half = float(stdtrit(count - 1, (1.0 + level) / 2.0)) * stdev(values) / math.sqrt(count)
    return Interval(mean, mean - half, mean + half)
