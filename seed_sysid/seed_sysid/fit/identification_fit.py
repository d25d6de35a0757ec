# SPDX-License-Identifier: Apache-2.0
"""The identification fit: six stiffnesses per grip by robust nonlinear least squares, with intervals.

It answers Sec. VI of the paper (System Identification), which names no formula: stiffness is the static sensitivity of
the wrench to the pose, found by perturbing the grasp of a force/torque sensor.

Minimised are the residuals of the load model (seed_sysid.fit.load_model), each divided by its channel's noise, which is
itself estimated from the residuals, apart for poses along one axis and for combinations, for the degrees of freedom
that these leave: n less the sum of their leverages. The steps:

1. linear least squares for stiffness and bias alone, where the rest is zero;
2. Gauss-Newton for all unknowns under a soft-L1 loss, which outliers do not pull far;
3. samples whose six residuals together are less likely than FitParameters.outlier are left out, and plain least squares
   finishes, so that the covariance (J^T J)^-1 means what it says;
4. standard deviations from that covariance, intervals by Student's t with the fewest degrees of freedom of any noise.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, stdtrit  # scipy.stats, which has them too, loads for half a second

from seed_core.spatial import Array
from seed_sysid.fit.load_model import LoadModel, Problem, Unknowns

GROUPS = 2  # of samples with a noise of their own
_LEAST_NOISE = np.array([1e-5] * 3 + [1e-4] * 3)  # [N m, N]; less is rounding
_START_NOISE = np.array([0.02] * 3 + [0.3] * 3)  # [N m, N]
_FEW = 12  # samples from which a group's noise can be told
_ROUNDS = 8  # of leaving out outliers
_STEPS, _CONVERGED = 40, 1e-2  # a step in units of about one standard deviation


@dataclass(frozen=True)
class Solution:
    """An identification fit.

    Attributes:
        value, std: all unknowns and their standard deviations.
        half_width: (G, 6) of each stiffness' confidence interval [N m/rad, N/m].
        residuals: (n, 6) [N m, N], prediction less measurement; of all samples, as all that follow.
        inlier: (n,) the samples that were fitted.
        likely: (n,) the samples that are no outliers to the final fit.
        sample_noise: (n, 6) [N m, N] standard deviation of each residual.
        noise, r_squared: (6,) [N m, N] each channel's standard deviation, and share of its variance that is explained.
        condition: of the Jacobian with columns of equal length.
    """

    value: Unknowns
    std: Unknowns
    half_width: Array
    residuals: Array
    inlier: np.ndarray
    likely: np.ndarray
    sample_noise: Array
    noise: Array
    r_squared: Array
    condition: float


def fit_stiffness(problem: Problem, train: np.ndarray | None = None) -> Solution:
    """The identification fit of a problem.

    Args:
        problem: n samples.
        train: (n,) mask of the samples to fit; None: all. The others are predicted.

    Returns:
        The unknowns, with residuals of all samples.
    """
    fit = _Fit(problem, np.ones(len(problem.X_TC), dtype=bool) if train is None else train)
    fit.start_linearly()
    for _ in range(2):
        fit.minimise(robust=True)
        fit.estimate_noise(robust=True)
    bulk = fit.noise  # a noise that shrinks with every outlier left out would leave out ever more
    for _ in range(_ROUNDS):
        inlier = fit.train & fit.likely(np.maximum(fit.noise, bulk))
        settled = np.array_equal(inlier, fit.inlier)
        fit.inlier = inlier
        fit.minimise(robust=False)
        fit.estimate_noise(robust=False)
        if settled:
            break
    return fit.solution()


class _Fit:
    """The fit on its way: unknowns (flat), noise by group (GROUPS, 6) and of all (6,), samples that take part (n,)."""

    def __init__(self, problem: Problem, train: np.ndarray) -> None:
        self.problem, self.train = problem, train
        self.model = LoadModel(problem, train)
        axes = np.isin(np.arange(6), problem.hysteretic)
        self.free = self.model.mask(problem.parameters.offset, problem.parameters.drift, axes)
        self.unknowns = np.zeros(len(self.free))
        self.noise, self.overall = np.tile(_START_NOISE, (GROUPS, 1)), _START_NOISE
        self.inlier = train

    def start_linearly(self) -> None:
        """Stiffness and bias alone: in them the load is linear while the offset is zero."""
        linear = self.model.mask(offset=False, drift=False, friction=False)
        weight = self._weight()
        A = weight[:, None] * self._jacobian()[:, linear]
        self.unknowns[linear] = np.linalg.lstsq(A, weight * self.problem.wrench.ravel(), rcond=None)[0]

    def minimise(self, robust: bool) -> None:
        """Gauss-Newton, with soft-L1 weights (1 + r^2)^-1/2 renewed at every step if robust."""
        weight = self._weight()
        for _ in range(_STEPS):
            r = weight * self._residuals().ravel()
            J, lengths = self._scaled_jacobian(weight)
            soft = 1.0 / np.sqrt(1.0 + r**2) if robust else np.ones_like(r)
            step = np.linalg.lstsq(J.T @ (soft[:, None] * J), -J.T @ (soft * r), rcond=1e-12)[0]
            self.unknowns[self.free] += step / lengths
            if np.abs(step).max() < _CONVERGED:
                break

    def estimate_noise(self, robust: bool) -> None:
        """Each group's standard deviation of each channel, for the degrees of freedom that its samples leave."""
        r, leverage = self._residuals(), self._leverage()
        self.noise = np.array([_deviation(r[mine], leverage[mine], robust) for mine in self._members()])
        self.overall = _deviation(r[self.inlier], leverage[self.inlier], robust)

    def likely(self, noise: Array) -> np.ndarray:
        """(n,) whether a sample's residuals together pass for noise (GROUPS, 6): their squared Mahalanobis distance."""
        distance = ((self._residuals() / noise[self.problem.group]) ** 2).sum(axis=1)
        return np.asarray(distance < chdtri(6, self.problem.parameters.outlier))

    def solution(self) -> Solution:
        """What was found, with standard deviations from the covariance (J^T J)^-1."""
        J, lengths = self._scaled_jacobian(self._weight())
        _, singular, Vt = np.linalg.svd(J, full_matrices=False)
        root = Vt.T / np.maximum(singular, 1e-12)
        std = np.zeros(len(self.free))
        std[self.free] = np.sqrt((root**2).sum(axis=1)) / lengths
        value, deviation, r = Unknowns.from_vector(self.unknowns), Unknowns.from_vector(std), self._residuals()
        measured = self.problem.wrench[self.inlier]
        total = ((measured - measured.mean(axis=0)) ** 2).sum(axis=0)
        leverage = self._leverage()
        fewest = min(float(_degrees(leverage[mine]).min()) for mine in self._members())
        quantile = float(stdtrit(fewest, 0.5 * (1.0 + self.problem.parameters.confidence)))
        return Solution(
            value=value,
            std=deviation,
            half_width=quantile * deviation.stiffness,
            residuals=r,
            inlier=self.inlier,
            likely=self.likely(self.noise),
            sample_noise=self.noise[self.problem.group],
            noise=self.overall,
            r_squared=1.0 - (r[self.inlier] ** 2).sum(axis=0) / np.maximum(total, 1e-300),
            condition=float(singular[0] / max(singular[-1], 1e-300)),
        )

    def _residuals(self) -> Array:
        # r = w(X_TC; stiffness and the other unknowns) - w_measured, by sample and channel
        return self.model.predict(Unknowns.from_vector(self.unknowns)) - self.problem.wrench

    def _jacobian(self) -> Array:
        return self.model.jacobian(Unknowns.from_vector(self.unknowns))

    def _weight(self) -> Array:
        """(6n,) one over the noise of each number; 0 where the sample does not take part."""
        return np.asarray((self.inlier[:, None] / self.noise[self.problem.group]).ravel())

    def _scaled_jacobian(self, weight: Array) -> tuple[Array, Array]:
        """(6n, m) weighted derivatives by the m free unknowns, as columns of length 1; and their lengths (m,)."""
        J = weight[:, None] * self._jacobian()[:, self.free]
        lengths = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        return J / lengths, lengths

    def _members(self) -> list[np.ndarray]:
        """(n,) by group, the fitted samples that tell its noise: its own, or all where these are few."""
        own = [self.inlier & (self.problem.group == g) for g in range(GROUPS)]
        return [mine if mine.sum() >= _FEW else self.inlier for mine in own]

    def _leverage(self) -> Array:
        """(n, 6) share of its own value in the prediction of each number: the diagonal of J (J^T J)^-1 J^T."""
        J, _ = self._scaled_jacobian(self._weight())
        inverse = np.linalg.pinv(J.T @ J, rcond=1e-12, hermitian=True)
        return np.asarray(np.einsum("ij,ij->i", J @ inverse, J).reshape(-1, 6))


def _degrees(leverage: Array) -> Array:
    """(6,) degrees of freedom that samples of this leverage (n, 6) leave in each channel."""
    return np.asarray(np.maximum(len(leverage) - leverage.sum(axis=0), 1.0))


def _deviation(r: Array, leverage: Array, robust: bool) -> Array:
    """(6,) standard deviation of the noise that has left residuals (n, 6) of this leverage."""
    spread = 1.4826 * np.median(np.abs(r), axis=0) if robust else np.sqrt(np.mean(r**2, axis=0))
    return np.asarray(np.maximum(spread * np.sqrt(len(r) / _degrees(leverage)), _LEAST_NOISE))
