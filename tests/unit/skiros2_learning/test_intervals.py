"""Confidence intervals, against known values, and their coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_learning.core.intervals import difference_sign, mean_interval, share_interval


@pytest.mark.parametrize(
    ("good", "count", "low", "high"),
    [(8, 10, 0.490, 0.943), (28, 30, 0.787, 0.982), (0, 10, 0.0, 0.278), (10, 10, 0.722, 1.0), (0, 0, 0.0, 1.0)],
)
def test_interval_of_a_share_is_that_of_wilson(good: int, count: int, low: float, high: float) -> None:
    found = share_interval(good, count)
    assert (found.low, found.high) == (pytest.approx(low, abs=1e-3), pytest.approx(high, abs=1e-3))


def test_interval_of_a_mean_is_that_of_student() -> None:
    found = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.776445 * math.sqrt(2.5 / 5)
    assert found.estimate == 3.0
    assert (found.low, found.high) == (pytest.approx(3.0 - half), pytest.approx(3.0 + half))


def test_mean_of_zeros_and_ones_is_a_share_and_one_value_says_nothing() -> None:
    assert mean_interval([1.0] * 10) == share_interval(10, 10)
    assert mean_interval([3.0]).low == -math.inf
    assert mean_interval([]).high == math.inf


@pytest.mark.parametrize("rate", [0.5, 0.57, 0.8, 0.95])
def test_interval_of_a_share_covers_the_true_rate(rate: float) -> None:
    good = np.random.default_rng(1).binomial(30, rate, 4000)
    covered = [found.low <= rate <= found.high for found in (share_interval(int(each), 30) for each in good)]
    assert np.mean(covered) >= 0.93


def test_a_difference_needs_confidence() -> None:
    assert difference_sign([1.0] * 9 + [0.0], [1.0] * 8 + [0.0] * 2) == 0
    assert difference_sign([1.0] * 6, [0.0] * 6) == 1
    assert difference_sign([0.0] * 6, [1.0] * 6) == -1
    assert difference_sign([1.0] * 5, [0.0] * 5) == 0  # 1 in 32 by chance, on each side
    assert difference_sign([2.0, 2.1, 1.9, 2.0], [1.0, 1.1, 1.2, 0.9]) == 1
    assert difference_sign([2.0, 0.1, 3.9, 1.0], [1.0, 1.1, 1.2, 0.9]) == 0


def test_equal_samples_differ_by_chance_only() -> None:
    random = np.random.default_rng(2)
    signs = [difference_sign(*(random.random((2, 30)) < 0.8).astype(float).tolist()) for _ in range(2000)]
    assert np.mean(np.array(signs) != 0) <= 0.05
