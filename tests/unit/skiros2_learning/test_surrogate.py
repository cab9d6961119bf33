"""The surrogate of the sampler: a Gaussian process that separates the function from noise."""

from __future__ import annotations

import numpy as np
import pytest

from skiros2_learning.core.surrogate import fit_surrogate


def test_deviation_is_that_of_the_function_not_of_its_values() -> None:
    random = np.random.default_rng(1)
    inputs = np.repeat(np.linspace(0.0, 1.0, 6), 10)[:, None]
    values = np.sin(3.0 * inputs[:, 0]) + random.normal(0.0, 0.5, len(inputs))
    mean, deviation = fit_surrogate(inputs, values, random).predict(np.array([[0.5]]))
    assert deviation[0] < 0.25
    assert mean[0] == pytest.approx(np.sin(1.5), abs=0.3)


def test_values_with_known_noise_count_less() -> None:
    inputs = np.array([[0.0], [0.5], [0.501], [1.0]])
    values, noise = np.array([0.0, 0.2, 3.0, 0.0]), np.array([0.01, 0.01, 9.0, 0.01])
    random = np.random.default_rng(1)
    mean, _ = fit_surrogate(inputs, values, random, noise=noise).predict(np.array([[0.5]]))
    assert mean[0] == pytest.approx(0.2, abs=0.3)


def test_values_without_an_order_are_equally_far_apart() -> None:
    random = np.random.default_rng(1)
    inputs = np.array([[float(k), x] for k in range(4) for x in np.linspace(0.0, 1.0, 5)])
    values = np.array([0.0, 5.0, 0.5, 5.5])[inputs[:, 0].astype(int)] + inputs[:, 1]
    model = fit_surrogate(inputs, values, random, nominal=[True, False])
    between = [[float(k), 0.4] for k in range(4)]
    assert model.predict(np.array(between))[0] == pytest.approx([0.4, 5.4, 0.9, 5.9], abs=0.1)
    shuffled = np.column_stack([(inputs[:, 0] * 3.0) % 5.0, inputs[:, 1]])
    again = fit_surrogate(shuffled, values, np.random.default_rng(1), nominal=[True, False])
    assert again.scales[0] == pytest.approx(model.scales[0], rel=0.05)


def test_a_trend_that_the_values_contradict_has_no_support() -> None:
    random = np.random.default_rng(1)
    inputs = random.random((20, 2))
    values = inputs.sum(axis=1)
    model = fit_surrogate(inputs, values, random)
    assert model.log_support(-values) > 0.0
    assert model.log_support(values) < -1.0
