"""Surrogates: regression models that predict a value of a configuration with its uncertainty."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from sklearn.ensemble import RandomForestRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from skiros2_learning.core.search_space import Array

#: A Gaussian process (Matérn 5/2, one length scale for each input), or a random forest.
SurrogateKind = Literal["gp", "forest"]
TREES = 30


@dataclass(frozen=True)
class Surrogate:
    """A regressor of normalised values, with their mean and their spread."""

    regressor: Any
    mean: float
    spread: float

    def predict(self, features: Array) -> tuple[Array, Array]:
        """Returns mean and standard deviation, each of shape (n,), for inputs of shape (n, d)."""
        if isinstance(self.regressor, RandomForestRegressor):
            trees = np.array([tree.predict(features) for tree in self.regressor.estimators_])
            mean, deviation = trees.mean(axis=0), trees.std(axis=0)
        else:
            mean, deviation = self.regressor.predict(features, return_std=True)
        return mean * self.spread + self.mean, np.maximum(deviation * self.spread, 1e-9)


def fit_surrogate(kind: SurrogateKind, features: Array, values: Array, random: np.random.Generator) -> Surrogate:
    """Fits a surrogate.

    :param features: inputs, shape (n, d), from 0 to 1.
    :param values: shape (n,).
    """
    spread = float(values.std()) or 1.0
    normal = (values - values.mean()) / spread
    seed = int(random.integers(2**31))
    if kind == "forest":
        forest = RandomForestRegressor(TREES, min_samples_leaf=2, max_features=0.8, random_state=seed)
        return Surrogate(forest.fit(features, normal), float(values.mean()), spread)
    scales = np.full(features.shape[1], 0.5)
    matern = ConstantKernel(1.0, (0.05, 20.0)) * Matern(scales, (0.03, 10.0), nu=2.5)
    kernel = matern + WhiteKernel(1e-3, (1e-6, 1.0))
    process = GaussianProcessRegressor(kernel, n_restarts_optimizer=0, random_state=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length scale at its bound is not a mistake
        return Surrogate(process.fit(features, normal), float(values.mean()), spread)
