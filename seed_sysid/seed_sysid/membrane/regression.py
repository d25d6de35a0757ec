# SPDX-License-Identifier: Apache-2.0
"""Linear regression whose groups of terms are shrunk as far as the data ask for (Gaussian prior, type II likelihood).

y = sum_g F_g c_g + noise, c_g ~ N(0, a_g), noise ~ N(0, s^2). The strengths a_g and s^2 maximise the probability of the
data, all terms integrated out; few poses or noisy features make them small and the function simple, and a group that
explains nothing vanishes. Noise of features is noise of y to it, which is what a user of noisy features needs.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from seed_core.spatial import Array

_START, _NOISE_START = -4.0, -5.0  # logarithms, for y of unit size
_WIDTH = 4.0  # standard deviation of their broad prior
_BOUNDS, _NOISE_BOUNDS = (-14.0, 4.0), (-11.0, 1.0)


class Regression(NamedTuple):
    """What was found.

    Attributes:
        strengths: (groups,) variance of the coefficients of each; noise: variance of y around the function.
        coefficients: by group.
        inverse: (n, n) of the covariance of y.
        left_out: (n,) error of each y predicted from all the others.
        weights: (n,) the inverse times y.
    """

    strengths: Array
    noise: float
    coefficients: list[Array]
    inverse: Array
    left_out: Array
    weights: Array

    def left_out_together(self, group: np.ndarray) -> Array:
        """(n,) error of each y predicted from those of other groups; group: (n,) number of each one's."""
        out = np.empty(len(self.left_out))
        for g in np.unique(group):
            mine = np.flatnonzero(group == g)
            out[mine] = np.linalg.solve(self.inverse[np.ix_(mine, mine)], self.weights[mine])
        return out

    def covariance(self, F: list[Array]) -> Array:
        """(terms, terms) of all coefficients, group after group, F as they were fitted."""
        A = np.hstack([f * a for f, a in zip(F, self.strengths, strict=True)])
        prior = np.concatenate([np.full(f.shape[1], a) for f, a in zip(F, self.strengths, strict=True)])
        return np.asarray(np.diag(prior) - A.T @ self.inverse @ A)


def regress(F: list[Array], y: Array, start: Array | None = None) -> Regression:
    """Fit y (n,) by groups of terms F [(n, terms)].

    Args:
        F: values of the terms.
        y: any unit.
        start: (groups + 1,) logarithms of strengths and noise, relative to the variance of y, from a similar problem.
    """
    size = float(np.sqrt(np.mean(y**2))) or 1.0
    v, n = y / size, len(y)
    kernels = np.array([f @ f.T for f in F])

    def cost(t: Array) -> tuple[float, Array]:
        K = np.tensordot(np.exp(t[:-1]), kernels, 1)
        K[np.diag_indices(n)] += np.exp(t[-1])
        factor = cho_factor(K, lower=True)
        inverse = cho_solve(factor, np.eye(n))
        w = inverse @ v
        slope = np.tensordot(kernels, inverse, 2) - np.einsum("i,gij,j->g", w, kernels, w)
        slopes = 0.5 * np.exp(t) * np.append(slope, np.trace(inverse) - w @ w)
        off = (t - centre) / _WIDTH
        value = 0.5 * float(v @ w) + float(np.log(np.diag(factor[0])).sum()) + 0.5 * float(off @ off)
        return value, slopes + off / _WIDTH

    centre = np.array([_START] * len(F) + [_NOISE_START])
    bounds = [_BOUNDS] * len(F) + [_NOISE_BOUNDS]
    t = minimize(cost, centre if start is None else start, jac=True, method="L-BFGS-B", bounds=bounds).x
    K = np.tensordot(np.exp(t[:-1]), kernels, 1)
    K[np.diag_indices(n)] += np.exp(t[-1])
    inverse = np.linalg.inv(K)
    w = inverse @ v
    return Regression(
        strengths=np.exp(t[:-1]) * size**2,
        noise=float(np.exp(t[-1])) * size**2,
        coefficients=[np.exp(a) * f.T @ w * size for a, f in zip(t[:-1], F, strict=True)],
        inverse=inverse / size**2,
        left_out=size * w / np.diag(inverse),
        weights=w / size,
    )
