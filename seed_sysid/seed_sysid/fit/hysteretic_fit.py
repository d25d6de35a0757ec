# SPDX-License-Identifier: Apache-2.0
"""The fit of a spring that stiffens and has hysteresis, to the samples of an ordinary identification.

The measured load is linear in everything but the poses of the sensor's frame and of the elastic centre: along each xi

    k xi + r xi |xi| + sum_i h_i z_i(way)

where the states z_i of elements that yield after a share of the axis' range are known from the way that the arm has
come, and from where the elastic centre is. Only that frame's six numbers and the centre's three are searched for; the
rest is linear least squares with h >= 0. Terms that the data do not show are left out: an axis has rise, or friction,
when it is clearly away from zero.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, nnls

from seed_core.hysteretic.spring import HystereticStiffness
from seed_core.spatial import Array, make_pose
from seed_sysid.fit.analysis import Analysis
from seed_sysid.fit.hysteresis import stop_states
from seed_sysid.fit.load_model import Problem
from seed_sysid.stiffness_map import AXES, offset_pose, stiffness_map, wrench_transform

YIELDS = (0.04, 0.1, 0.25, 0.6)  # shares of an axis' range at which elements yield
_SIGNIFICANT = 3.0  # standard deviations
_SCALE = np.array([0.02] * 3 + [0.002] * 6)  # [rad], [m] of the sensor's frame and of the centre
_FLOOR = np.array([1e-4] * 3 + [1e-3] * 3)  # [N m], [N] of noise that is always there


@dataclass(frozen=True)
class HystereticFit:
    """A spring, and what it leaves beside the linear fit of the same samples.

    Attributes:
        identified: the spring of the grip.
        std: (6, 2 + n) standard deviations of k, r and the friction of each element.
        left, left_linear: (6,) rms of the residuals of this fit and of the linear one with friction [N m, N].
        shown: by axis, which of 'rise' and 'friction' the data show.
    """

    identified: HystereticStiffness
    std: Array
    left: Array
    left_linear: Array
    shown: dict[str, tuple[str, ...]]


def fit_hysteretic(a: Analysis) -> HystereticFit:
    """Fit the middle grip of an analysis; outliers that it has found stay out."""
    problem = a.problem
    keep = a.solution.inlier & (problem.grip == a.nominal)
    work = _Fit(problem, keep, a.solution.noise)
    work.search(np.concatenate([a.solution.value.offset, np.zeros(3)]))
    work.drop_what_is_not_shown()
    return work.result(np.sqrt((a.solution.residuals[keep] ** 2).mean(axis=0)))


class _Fit:
    """One fit in progress.

    Attributes:
        use: (6, 2 + n) terms that take part. parameters: (6, 2 + n) k, r and friction.
    """

    def __init__(self, problem: Problem, keep: np.ndarray, noise: Array) -> None:
        self._problem, self._keep = problem, keep
        self.wrench = problem.wrench[keep]
        time = problem.time[keep]
        self.s = (time - time.mean()) / (float(np.ptp(time)) or 1.0)
        self.noise = np.maximum(noise, _FLOOR)
        self.use = np.ones((6, 2 + len(YIELDS)), dtype=bool)
        self._solve(np.zeros(9))

    def search(self, start: Array) -> None:
        """Find the sensor's frame and the centre (9,), all else following from them, and the noise of each channel."""

        def residuals(q: Array) -> Array:
            return self._solve(q * _SCALE)

        for _ in range(2):
            found = least_squares(residuals, start / _SCALE, method="lm", xtol=1e-4, ftol=1e-6)
            start = found.x * _SCALE
            self._solve(start)
            self.noise = np.maximum(self.residuals.std(axis=0), _FLOOR)
        self._solve(start)

    def _place(self, centre: Array) -> None:
        """B (n, 6, 6), terms (n, 6, 2 + elements) and range (6,) of the fitted poses about a centre (3,) [m]."""
        to_C, model, keep = make_pose(None, centre), self._problem.parameters.model, self._keep
        to_T = make_pose(None, -centre)
        path = stiffness_map(to_T @ self._problem.path @ to_C, model).xi
        self.B, xi = stiffness_map(to_T @ self._problem.X_TC[keep] @ to_C, model)
        self.B = wrench_transform(to_C) @ self.B
        self.largest = np.maximum(np.abs(xi).max(axis=0), 1e-9)
        self.yields = np.outer(YIELDS, self.largest)
        problem = self._problem
        states = [stop_states(path, problem.index, y, problem.grasps)[keep] for y in self.yields]
        self.terms = np.stack([xi, xi * np.abs(xi), *states], axis=2)

    def _columns(self, offset: Array) -> Array:
        """(6 n, parameters) of the terms in use, then bias (6) and drift (6), weighted."""
        moved = wrench_transform(offset_pose(offset)) @ self.B  # (n, 6, 6)
        blocks = [moved[:, :, j : j + 1] * self.terms[:, None, j, self.use[j]] for j in range(6)]
        n, eye = len(self.s), np.eye(6)
        blocks += [np.broadcast_to(eye, (n, 6, 6)), self.s[:, None, None] * eye]
        return np.asarray((np.concatenate(blocks, axis=2) / self.noise[:, None]).reshape(6 * n, -1))

    def _solve(self, q: Array) -> Array:
        """Least squares for all but the frame's offset and the centre, q (9,); the weighted residuals, flat."""
        self.offset, self.centre = q[:6], q[6:]
        self._place(self.centre)
        A, b = self._columns(self.offset), (self.wrench / self.noise).ravel()
        free = np.concatenate([*(np.arange(self.use.shape[1])[self.use[j]] < 2 for j in range(6)), np.ones(12, bool)])
        # friction is not negative: nnls of what the free columns leave
        Q, _ = np.linalg.qr(A[:, free])
        bound = A[:, ~free]
        x = np.zeros(A.shape[1])
        if bound.shape[1]:
            length = np.maximum(np.linalg.norm(bound, axis=0), 1e-12)
            projected = bound / length
            x[~free] = nnls(projected - Q @ (Q.T @ projected), b - Q @ (Q.T @ b), maxiter=2000)[0] / length
        x[free] = np.linalg.lstsq(A[:, free], b - bound @ x[~free], rcond=None)[0]
        self.x = x
        self.residuals = (self.wrench / self.noise - (A @ x).reshape(-1, 6)) * self.noise
        return np.asarray(b - A @ x)

    @property
    def parameters(self) -> Array:
        """(6, 2 + elements), 0 where a term is not in use."""
        out = np.zeros(self.use.shape)
        out[self.use] = self.x[: int(self.use.sum())]
        return out

    def covariance(self) -> Array:
        """(6, 2 + elements, 2 + elements), by axis; friction that is held at zero has none."""
        A = self._columns(self.offset)
        count = int(self.use.sum())
        active = self.x != 0.0
        inverse = np.zeros((A.shape[1],) * 2)
        inverse[np.ix_(active, active)] = np.linalg.pinv(A[:, active].T @ A[:, active], hermitian=True)
        out = np.zeros((6, *(self.use.shape[1],) * 2))
        place = np.argwhere(self.use)
        for axis in range(6):
            mine = np.flatnonzero(place[:count, 0] == axis)
            at = place[mine, 1]
            out[axis][np.ix_(at, at)] = inverse[np.ix_(mine, mine)]
        return out

    def drop_what_is_not_shown(self) -> None:
        """Leave out rise and friction that are not clearly away from zero, each axis by itself, and fit again."""
        C, x = self.covariance(), self.parameters
        for axis in range(6):
            if abs(x[axis, 1]) < _SIGNIFICANT * np.sqrt(C[axis, 1, 1]):
                self.use[axis, 1] = False
            if x[axis, 2:].sum() < _SIGNIFICANT * np.sqrt(max(float(C[axis, 2:, 2:].sum()), 0.0)):
                self.use[axis, 2:] = False
        self.search(np.concatenate([self.offset, self.centre]))

    def result(self, left_linear: Array) -> HystereticFit:
        """What was found."""
        x, C = self.parameters, self.covariance()
        names = ("rise", "friction")
        shown = {
            axis: tuple(n for n, there in zip(names, (x[j, 1] != 0.0, x[j, 2:].any()), strict=True) if there)
            for j, axis in enumerate(AXES)
        }
        left = np.sqrt((self.residuals**2).mean(axis=0))
        identified = HystereticStiffness(
            stiffness=x[:, 0],
            rise=x[:, 1],
            yields=self.yields,
            friction=x[:, 2:].T.copy(),
            covariance=C,
            residual=left,
            largest=self.largest,
            centre=self.centre,
        )
        return HystereticFit(identified, np.sqrt(np.diagonal(C, axis1=1, axis2=2)), left, left_linear, shown)
