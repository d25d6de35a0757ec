# SPDX-License-Identifier: Apache-2.0
"""Six stiffnesses per grip from poses and wrenches, with the sensor's bias, drift and frame offset as nuisances.

The measured load on the sensor, moved to the nominal tool frame T', is

    w' = Ad(X_T'T) B (K_g xi + h z) + b_g + d s        B, xi: seed_sysid.stiffness_map; g: grip; s: time, -1/2 to 1/2

with the unknown frame offset X_T'T = (exp(phi), t), bias b_g per grip, drift d, and on hysteretic axes friction h z (z:
fit.hysteresis). Residuals are divided by their channel's noise, which is estimated from them, apart for poses
along one axis and for combinations, whose poses an estimator knows less well. A soft-L1 loss first, then samples whose
six residuals together are less likely than FitParameters.outlier are left out by name and plain least squares
finishes, so that the covariance (J^T J)^-1 means what it says.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from seed_core.spatial import Array, skew, so3_exp
from seed_sysid.parameters import FitParameters
from seed_sysid.stiffness_map import Map, skews, stiffness_map

_FLOOR = np.array([1e-5] * 3 + [1e-4] * 3)  # [N m, N]; noise below this is rounding
_START_NOISE = np.array([0.02] * 3 + [0.3] * 3)  # [N m, N], of every group
GROUPS = 2  # of samples with a noise of their own
_FEW = 12  # samples from which a group's noise can be told
_ROUNDS = 8
_STEPS, _CONVERGED = 40, 1e-2  # a step in units of about one standard deviation


@dataclass(frozen=True)
class Problem:
    """What is fitted: n samples of G grips.

    Attributes:
        X_TC: (n, 4, 4); wrench: (n, 6) about T', in T'; grip: (n,) from 0; time: (n,) [s].
        path: (m, 4, 4) all points where the arm turned, in order; index: (n,) which of them the samples are.
        z: (n, 6) friction states, used on `hysteretic` axes.
        group: (n,) which of GROUPS noises a sample has: 0 along one axis, 1 a combination; None: all 0.
    """

    X_TC: Array
    wrench: Array
    grip: np.ndarray
    time: Array
    path: Array
    index: np.ndarray
    parameters: FitParameters = field(default_factory=FitParameters)
    z: Array | None = None
    hysteretic: tuple[int, ...] = ()
    group: np.ndarray | None = None


@dataclass(frozen=True)
class Solution:
    """A fit.

    Attributes:
        stiffness, stiffness_std, stiffness_half_width: (G, 6) [N m/rad, N/m]; half width of the confidence interval.
        offset, offset_std: rotation vector [rad] and translation [m] of T in T' (6,).
        bias: (G, 6); drift: (6,) over the whole run; friction: (6,) [N m, N], 0 where not fitted.
        residuals: (n, 6) [N m, N] of all samples; noise: (6,) standard deviation per channel, group_noise (GROUPS, 6)
            that of each group; r_squared: (6,).
        inlier: (n,) bool; distance: (n,) squared Mahalanobis distance of the residuals, chi-squared with 6 degrees.
        condition: of the Jacobian with columns of equal length.
    """

    stiffness: Array
    stiffness_std: Array
    stiffness_half_width: Array
    stiffness_covariance: Array
    offset: Array
    offset_std: Array
    bias: Array
    bias_std: Array
    drift: Array
    drift_std: Array
    friction: Array
    friction_std: Array
    residuals: Array
    noise: Array
    group_noise: Array
    r_squared: Array
    inlier: np.ndarray
    distance: Array
    condition: float
    degrees: float

    def noise_of(self, problem: Problem) -> Array:
        """(n, 6) standard deviation of every residual of a problem."""
        group = np.zeros(len(problem.X_TC), dtype=int) if problem.group is None else problem.group
        return np.asarray(self.group_noise[group])


class _Model:
    """Prediction and Jacobian over a flat parameter vector [K (6G), offset (6), bias (6G), drift (6), friction (m)]."""

    def __init__(self, problem: Problem) -> None:
        self.map: Map = stiffness_map(problem.X_TC, problem.parameters.model)
        self.problem, self.n = problem, len(problem.X_TC)
        self.grips = int(problem.grip.max()) + 1
        span = float(np.ptp(problem.time)) or 1.0
        self.s = (problem.time - problem.time.mean()) / span
        self.axes = list(problem.hysteretic)
        self.z = np.zeros((self.n, 6)) if problem.z is None else problem.z
        sizes = (6 * self.grips, 6, 6 * self.grips, 6, len(self.axes))
        ends = np.cumsum(sizes)
        self.k, self.o, self.b, self.d, self.h = (slice(e - s, e) for e, s in zip(ends, sizes, strict=True))
        self.size = int(ends[-1])
        self.free = np.ones(self.size, dtype=bool)
        self.free[self.o], self.free[self.d] = problem.parameters.offset, problem.parameters.drift
        self.rows = np.arange(self.n)
        self.group = np.zeros(self.n, dtype=int) if problem.group is None else problem.group

    def start(self) -> Array:
        """Parameters by linear least squares without offset and friction."""
        theta = np.zeros(self.size)
        theta[self.k] = np.tile([1.0] * 3 + [100.0] * 3, self.grips)
        J = self.jacobian(theta) / np.tile(_START_NOISE, self.n)[:, None]
        linear = np.r_[np.arange(self.k.start, self.k.stop), np.arange(self.b.start, self.b.stop)]
        y = (self.problem.wrench / _START_NOISE).ravel()
        theta[linear] = np.linalg.lstsq(J[:, linear], y, rcond=None)[0]
        return theta

    def _spring(self, theta: Array) -> Array:
        """(n, 6) about T, in T."""
        load = theta[self.k].reshape(self.grips, 6)[self.problem.grip] * self.map.xi
        load[:, self.axes] += theta[self.h] * self.z[:, self.axes]
        return np.asarray(np.einsum("nij,nj->ni", self.map.B, load))

    def predict(self, theta: Array) -> Array:
        """(n, 6) about T', in T'."""
        w = self._spring(theta)
        R = so3_exp(theta[self.o][:3])
        torque, force = w[:, :3] @ R.T, w[:, 3:] @ R.T
        moved = np.hstack([torque + np.cross(theta[self.o][3:], force), force])
        bias = theta[self.b].reshape(self.grips, 6)[self.problem.grip]
        return np.asarray(moved + bias + self.s[:, None] * theta[self.d])

    def jacobian(self, theta: Array) -> Array:
        """(6n, size)."""
        w, o = self._spring(theta), theta[self.o]
        R, left = so3_exp(o[:3]), left_jacobian(o[:3])
        torque, force = w[:, :3] @ R.T, w[:, 3:] @ R.T
        carry = np.zeros((6, 6))
        carry[:3, :3], carry[3:, 3:], carry[:3, 3:] = R, R, skew(o[3:]) @ R
        columns = carry @ self.map.B
        J = np.zeros((self.n, 6, self.size))
        for j in range(6):
            J[self.rows, :, 6 * self.problem.grip + j] = columns[:, :, j] * self.map.xi[:, j, None]
            J[self.rows, j, self.b.start + 6 * self.problem.grip + j] = 1.0
            J[:, j, self.d.start + j] = self.s
        turn = -skews(force) @ left
        J[:, 3:, self.o.start : self.o.start + 3] = turn
        J[:, :3, self.o.start : self.o.start + 3] = -skews(torque) @ left + skew(o[3:]) @ turn
        J[:, :3, self.o.start + 3 : self.o.stop] = -skews(force)
        for i, j in enumerate(self.axes):
            J[:, :, self.h.start + i] = columns[:, :, j] * self.z[:, j, None]
        return J.reshape(6 * self.n, self.size)


def left_jacobian(v: Array) -> Array:
    """(3, 3) with exp(v + dv) = exp(J dv) exp(v) to first order."""
    angle, K = float(np.linalg.norm(v)), skew(v)
    if angle < 1e-4:
        return np.eye(3) + 0.5 * K + K @ K / 6.0
    a, b = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + a * K + b * (K @ K))


def solve(problem: Problem) -> Solution:
    """Fit the problem (see the module's text)."""
    model = _Model(problem)
    inlier = np.ones(model.n, dtype=bool)
    theta = _minimise(model, model.start(), np.tile(_START_NOISE, (GROUPS, 1)), inlier, True)
    noise = _noise(model, theta, inlier, robust=True)
    theta = _minimise(model, theta, noise, inlier, True)
    noise = _noise(model, theta, inlier, robust=True)
    bound = float(chi2.isf(problem.parameters.outlier, 6))
    whole = noise  # of the bulk: the gate does not close on itself
    for _ in range(_ROUNDS):
        now = _distance(model, theta, np.maximum(noise, whole)) < bound
        settled = bool((now == inlier).all())
        inlier = now
        theta = _minimise(model, theta, noise, inlier, False)
        noise = _noise(model, theta, inlier, robust=False)
        if settled:
            break
    return _solution(model, theta, noise, inlier)


def _minimise(model: _Model, theta: Array, noise: Array, inlier: np.ndarray, robust: bool) -> Array:
    """Gauss-Newton, with soft-L1 weights (1 + r^2)^-1/2 renewed at every step if robust."""
    theta, weight = theta.copy(), _weight(model, noise, inlier)
    for _ in range(_STEPS):
        r = weight * (model.predict(theta) - model.problem.wrench).ravel()
        J = weight[:, None] * model.jacobian(theta)[:, model.free]
        soft = 1.0 / np.sqrt(1.0 + r**2) if robust else np.ones_like(r)
        lengths = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        J /= lengths
        step = np.linalg.lstsq(J.T @ (soft[:, None] * J), -J.T @ (soft * r), rcond=1e-12)[0]
        theta[model.free] += step / lengths
        if np.abs(step).max() < _CONVERGED:
            break
    return theta


def _weight(model: _Model, noise: Array, inlier: np.ndarray) -> Array:
    """(6n,) one over the noise (GROUPS, 6) of each number; 0 for outliers."""
    return np.asarray((inlier[:, None] / noise[model.group]).ravel())


def _noise(model: _Model, theta: Array, inlier: np.ndarray, robust: bool) -> Array:
    """(GROUPS, 6) standard deviation of each channel, for the degrees of freedom that the fit has used."""
    r = model.predict(theta) - model.problem.wrench
    groups = [inlier & (model.group == g) for g in range(GROUPS)]
    spread = np.array([_spread(r[mine] if mine.sum() >= _FEW else r[inlier], robust) for mine in groups])
    return np.asarray(np.maximum(spread * np.sqrt(inlier.sum() / _degrees(model, inlier)), _FLOOR))


def _spread(r: Array, robust: bool) -> Array:
    """(6,) standard deviation of residuals (n, 6) around zero."""
    return np.asarray(1.4826 * np.median(np.abs(r), axis=0) if robust else np.sqrt(np.mean(r**2, axis=0)))


def _degrees(model: _Model, inlier: np.ndarray) -> float:
    return max(1.0, float(inlier.sum()) - float(model.free.sum()) / 6.0)


def _distance(model: _Model, theta: Array, noise: Array) -> Array:
    r = (model.predict(theta) - model.problem.wrench) / noise[model.group]
    return np.asarray((r**2).sum(axis=1))


def _solution(model: _Model, theta: Array, noise: Array, inlier: np.ndarray) -> Solution:
    weight = _weight(model, noise, inlier)
    J = weight[:, None] * model.jacobian(theta)[:, model.free]
    lengths = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    _, singular, Vt = np.linalg.svd(J / lengths, full_matrices=False)
    root = Vt.T / np.maximum(singular, 1e-12)
    covariance = np.zeros((model.size, model.size))
    covariance[np.ix_(model.free, model.free)] = (root @ root.T) / np.outer(lengths, lengths)
    std, r = np.sqrt(np.diag(covariance)), model.predict(theta) - model.problem.wrench
    degrees = _degrees(model, inlier)
    quantile = float(student.isf(0.5 * (1.0 - model.problem.parameters.confidence), degrees))
    friction, friction_std = np.zeros(6), np.zeros(6)
    friction[model.axes], friction_std[model.axes] = theta[model.h], std[model.h]
    shape = (model.grips, 6)
    return Solution(
        stiffness=theta[model.k].reshape(shape),
        stiffness_std=std[model.k].reshape(shape),
        stiffness_half_width=quantile * std[model.k].reshape(shape),
        stiffness_covariance=covariance[model.k, model.k],
        offset=theta[model.o],
        offset_std=std[model.o],
        bias=theta[model.b].reshape(shape),
        bias_std=std[model.b].reshape(shape),
        drift=theta[model.d],
        drift_std=std[model.d],
        friction=friction,
        friction_std=friction_std,
        residuals=r,
        noise=np.maximum(_spread(r[inlier], False) * np.sqrt(inlier.sum() / degrees), _FLOOR),
        group_noise=noise,
        r_squared=_r_squared(model, r, inlier),
        inlier=inlier,
        distance=_distance(model, theta, noise),
        condition=float(singular[0] / max(singular[-1], 1e-300)),
        degrees=degrees,
    )


def _r_squared(model: _Model, r: Array, inlier: np.ndarray) -> Array:
    """(6,) share of each channel's variance that the fit explains."""
    w = model.problem.wrench[inlier]
    total = ((w - w.mean(axis=0)) ** 2).sum(axis=0)
    return np.asarray(1.0 - (r[inlier] ** 2).sum(axis=0) / np.maximum(total, 1e-300))
