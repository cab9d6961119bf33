"""A surrogate: a Gaussian process that predicts a value of a configuration with its uncertainty.

The kernel is Matérn 5/2 with one length scale for each input. Inputs without an order differ by 1 or not at all
(Hamming distance). The hyperparameters maximise the posterior, with the priors of Optuna's GPSampler: inverse
squared length scales near 1, a variance near 1 (Gamma(2, 1)), little noise (Gamma(1.1, 30)).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.optimize import minimize
from scipy.spatial.distance import cdist
from scipy.special import log_ndtr

from skiros2_learning.core.search_space import Array

#: Values to which the hyperparameters are fitted, and which are known to the process: drawn from more ones.
_FITTED, _KNOWN = 100, 1500
#: Starts of the hyperparameters, with more than `_MANY` values one less, and iterations of each.
_STARTS, _MANY, _ITERATIONS = 3, 60, 40
#: Of the function, for values with variance 1: no model is exact.
_LEAST_VARIANCE = 1e-6
#: Bounds of length scales, variance and noise (variance), of values with variance 1.
_SCALES, _VARIANCES, _NOISES = (0.02, 50.0), (0.05, 20.0), (1e-6, 2.0)


@dataclass(frozen=True)
class Surrogate:
    """A fitted Gaussian process of normalised values, with their mean and their spread.

    :param nominal: for each input, whether its values have no order, shape (d,).
    :param factor: lower Cholesky factor of the covariance of the values, shape (n, n).
    :param weights: solution of covariance and normalised values, shape (n,).
    """

    features: Array
    nominal: npt.NDArray[np.bool_]
    scales: Array
    variance: float
    factor: Array
    weights: Array
    normal: Array
    mean: float
    spread: float

    def predict(self, features: Array) -> tuple[Array, Array]:
        """Returns mean and standard deviation of the function, without noise, each of shape (n,), for inputs of shape
        (n, d)."""
        covariance = _kernel(self._distances(features), self.variance)
        half = solve_triangular(self.factor, covariance.T, lower=True, check_finite=False)
        rest = np.maximum(self.variance - (half**2).sum(axis=0), _LEAST_VARIANCE)
        return covariance @ self.weights * self.spread + self.mean, np.sqrt(rest) * self.spread

    def log_support(self, trend: Array) -> float:
        """Returns the logarithm of the Bayes factor of a falling linear trend: how much better the values are
        explained if they are lower where `trend` is higher.

        :param trend: at the fitted values, shape (n,). Its coefficient has a half-normal prior of deviation 1, for
            trend and values of variance 1.
        """
        spread = float(trend.std())
        if spread < 1e-9:
            return 0.0
        half = solve_triangular(self.factor, (trend - trend.mean()) / spread, lower=True)
        precision = 1.0 + float(half @ half)
        slope = float(half @ solve_triangular(self.factor, self.normal, lower=True)) / precision
        two_sided = 0.5 * slope**2 * precision - 0.5 * math.log(precision)
        return two_sided + math.log(2.0) + float(log_ndtr(-slope * math.sqrt(precision)))

    def _distances(self, features: Array) -> Array:
        """Squared scaled distances of inputs to those of the values, shape (m, n)."""
        ordered = ~self.nominal
        found: Array = cdist(
            features[:, ordered] / self.scales[ordered], self.features[:, ordered] / self.scales[ordered], "sqeuclidean"
        )
        for i in np.flatnonzero(self.nominal):
            found += (features[:, i, None] != self.features[None, :, i]) / self.scales[i] ** 2
        return found


def fit_surrogate(
    features: Array,
    values: Array,
    random: np.random.Generator,
    *,
    nominal: Sequence[bool] = (),
    noise: Array | None = None,
) -> Surrogate:
    """Fits a surrogate.

    :param features: inputs, shape (n, d), from 0 to 1; of nominal ones, any number for each value.
    :param values: shape (n,).
    :param nominal: for each input, whether its values have no order; () for none.
    :param noise: variances of the values that are known, shape (n,); further noise is estimated. None for 0.
    """
    mask = np.array(nominal, dtype=bool) if len(nominal) else np.zeros(features.shape[1], dtype=bool)
    known = np.zeros(len(values)) if noise is None else noise
    if len(values) > _KNOWN:
        kept = random.choice(len(values), _KNOWN, replace=False)
        features, values, known = features[kept], values[kept], known[kept]
    mean, spread = float(values.mean()), float(values.std()) or 1.0
    normal, known = (values - mean) / spread, known / spread**2
    part = random.choice(len(values), _FITTED, replace=False) if len(values) > _FITTED else np.arange(len(values))
    best = _fitted(features[part], normal[part], known[part], mask, random)
    scales: Array = np.exp(best[:-2])
    variance, residual = math.exp(best[-2]), math.exp(best[-1])
    made = Surrogate(features, mask, scales, variance, np.empty(0), np.empty(0), normal, mean, spread)
    covariance = _kernel(made._distances(features), variance) + np.diag(known + residual)
    factor = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    weights = cho_solve((factor, True), normal)
    return Surrogate(features, mask, scales, variance, factor, weights, normal, mean, spread)


def _fitted(
    features: Array, values: Array, known: Array, nominal: npt.NDArray[np.bool_], random: np.random.Generator
) -> Array:
    """Returns the logarithms of length scales, variance and noise: the best of several starts."""
    count, dimensions = features.shape
    # matrices are symmetric: only what is below the diagonal is computed, as vectors
    rows, columns = np.tril_indices(count, -1)
    below, diagonal = rows + count * columns, np.arange(count) * (count + 1)
    apart = (features[rows] - features[columns]).T ** 2
    apart[nominal] = apart[nominal] > 0.0
    bounds = [tuple(map(math.log, each)) for each in [_SCALES] * dimensions + [_VARIANCES, _NOISES]]

    def cost(theta: Array) -> tuple[float, Array]:
        inverse = np.exp(-2.0 * theta[:dimensions])
        variance, residual = math.exp(theta[-2]), math.exp(theta[-1])
        squared = inverse @ apart
        root = np.sqrt(5.0 * squared)
        decay = variance * np.exp(-root)
        covariance = (1.0 + root + 5.0 / 3.0 * squared) * decay
        matrix = np.empty(count * count)  # by columns, as LAPACK expects
        matrix[below] = covariance
        matrix[diagonal] = variance + known + residual + 1e-10
        factor, failed = dpotrf(matrix.reshape(count, count).T, lower=True, overwrite_a=True, clean=False)
        if failed:
            return 1e10, np.zeros_like(theta)
        evidence = -float(np.log(matrix[diagonal]).sum())
        weights, _ = dpotrs(factor, values, lower=True)
        evidence -= 0.5 * float(values @ weights)
        dpotri(factor, lower=True, overwrite_c=True)
        # derivative of the log evidence by the covariance, times 2
        change = weights[rows] * weights[columns] - matrix[below]
        trace = float(weights @ weights - matrix[diagonal].sum())
        slopes = np.empty_like(theta)
        slopes[:dimensions] = apart @ (change * (5.0 / 3.0 * (1.0 + root) * decay)) * inverse
        slopes[-2] = float(change @ covariance) + 0.5 * trace * variance
        slopes[-1] = 0.5 * trace * residual
        prior = theta[-2] - variance + 0.1 * theta[-1] - 30.0 * residual
        prior -= 0.1 * float((inverse + 1.0 / inverse).sum())
        slopes[:dimensions] += 0.2 * (inverse - 1.0 / inverse)
        slopes[-2] += 1.0 - variance
        slopes[-1] += 0.1 - 30.0 * residual
        return -evidence - prior, -slopes

    starts = [np.array([math.log(0.5)] * dimensions + [0.0, math.log(1e-3)])]
    starts.append(np.array([0.0] * dimensions + [0.0, math.log(1e-2)]))
    while len(starts) < _STARTS - (len(values) > _MANY):
        starts.append(np.append(random.uniform(math.log(0.1), math.log(3.0), dimensions), [0.0, math.log(1e-2)]))
    found = [
        minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _ITERATIONS})
        for start in starts
    ]
    best: Array = min(found, key=lambda each: float(each.fun)).x
    return best


def _kernel(squared: Array, variance: float) -> Array:
    """Matérn 5/2 of squared scaled distances."""
    root = np.sqrt(5.0 * squared)
    covariance: Array = variance * (1.0 + root + root**2 / 3.0) * np.exp(-root)
    return covariance
