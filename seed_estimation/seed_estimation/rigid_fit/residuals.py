# SPDX-License-Identifier: Apache-2.0
"""One finger's points in one frame: which still touch the tool, their residuals, weights and information.

Robust weights are Cauchy's. Neighbouring residuals are not independent, so the information that they claim is worth
little by itself; `scatter` says how far parts of the patch contradict each other, which is what covariance is made of.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose
from seed_estimation.contact.surface import Vec, touches
from seed_estimation.images.sampling import Frame, project32, sample
from seed_estimation.rigid_fit.reference import FingerModel

ROBUST = 2.0  # residuals of this many deviations weigh half (Cauchy)
SHARE_IMAGE = 1.0 / 6.0  # neighbouring residuals are not independent: a blurred dot covers about six pixels
SHARE_DEPTH = 1.0 / 3.0  # depth is averaged over 3 x 3 pixels and read at about every second one
DEPTH_FLOOR = 1.0e-4  # [m] what a depth image gets wrong in common, however still it is
DEPTH_COMMON = 6.0e-5  # [m] of it, what a whole patch gets wrong by one and the same amount
IMAGE_FLOOR = 0.05  # [1] the same of a normalised image
UNKNOWNS = 6  # of a pose
FEW = 60  # points; fewer that touch tell nothing
ONE = np.float32(1.0)


class Residuals:
    """Residuals r (N,) of one image, their weights and Jacobian (6, N); the deviation of the noise is kept once found.

    Attributes:
        H, g: (6, 6) information about xi, and (6,) gradient.
    """

    def __init__(self, J: Vec, cells: NDArray[np.intp], share: float, floor: float, common: float = 0.0) -> None:
        self.J, self.cells, self.share, self.floor, self.common = J, cells, share, floor, common
        self.deviation = floor
        self.r = self.w = np.zeros(0, np.float32)
        self.Jw = J[:, :0]
        self.H, self.g = np.zeros((6, 6)), np.zeros(6)

    @property
    def scale(self) -> float:
        """From weighted sums to information."""
        return self.share / self.deviation**2

    def weigh(self, r: Vec, rescale: bool) -> None:
        """What is not seen is far out and weighs nothing."""
        if r.size < FEW:
            return
        if rescale:
            some = np.abs(r[::3])
            self.deviation = max(1.4826 * float(np.partition(some, some.size // 2)[some.size // 2]), self.floor)
        scaled = r * np.float32(1.0 / (ROBUST * self.deviation))
        self.w = ONE / (ONE + scaled * scaled)
        self.r, self.Jw = r, self.J * self.w
        self.H = (self.Jw @ self.J.T).astype(float) * self.scale
        self.g = (self.Jw @ r).astype(float) * self.scale

    def scatter(self) -> Array:
        """(6, 6) sum of g_c g_c^T over the patch's cells c: what the gradient's own uncertainty is.

        What all of a patch gets wrong alike, by `common`, no cell contradicts; it is added.
        """
        if self.r.size == 0:
            return np.zeros((6, 6))
        edges = np.flatnonzero(self.cells[1:] != self.cells[:-1]) + 1
        g = np.add.reduceat(self.Jw * self.r, np.concatenate(((0,), edges)), axis=1).astype(float) * self.scale
        alike = self.common * self.scale * self.Jw.sum(axis=1).astype(float)
        count = g.shape[1]
        few = count / max(count - UNKNOWNS, 1)  # a handful of cells is fitted better than it should be
        return np.asarray(few * (g @ g.T) + np.outer(alike, alike))


class Sight:
    """Image and depth residuals of one finger at one level (0 coarse, 1 fine) of one frame."""

    def __init__(self, model: FingerModel, frame: Frame, X_CT: Array, slip: float, level: int) -> None:
        """X_CT (4, 4): about where the tool is; it decides what still touches."""
        self.model, self.frame, self.slip = model, frame, slip
        self._picture = frame.fine if level else frame.coarse
        points = model.levels[level]
        p, n = model.surfaces[level]
        touching = _touching(model, p, n, model.X_XC @ X_CT)
        first = int(np.searchsorted(touching, points.value.size))
        d = touching[first:] - points.value.size
        self.index = touching[:first]  # of the image's points
        self.points, self.p = points.chosen(self.index), p.take(touching, axis=1)
        self.n, self.n_p = model.n.take(d, axis=1), model.n_p[d]
        self.image = Residuals(self.points.jacobian(slip), self.points.cells, SHARE_IMAGE, IMAGE_FLOOR)
        self.depth = Residuals(model.J.take(d, axis=1), model.cells[d], SHARE_DEPTH, DEPTH_FLOOR, DEPTH_COMMON)

    def evaluate(self, X_CT: Array, rescale: bool) -> None:
        """Residuals, weights and information at a pose."""
        X_XT, count = self.model.X_XC @ X_CT, self.points.value.size
        R, t = _single(X_XT)
        P = R @ self.p + t
        if self.slip > 0.0:
            self._leave_behind(P[:, :count], R)
        pixels = project32(self.model.camera, P)
        pixels -= np.array(self.frame.origin, np.float32)[:, None]
        self.image.weigh(sample(self._picture, pixels[:, :count]) - self.points.value, rescale)
        eye = inverse_pose(X_XT)[:3, 3].astype(np.float32)  # the camera in the tool's frame
        z = sample(self.frame.depth, pixels[:, count:])
        self.depth.weigh((ONE - z / P[2, count:]) * (self.n_p - eye @ self.n), rescale)

    def _leave_behind(self, moved: Vec, R: Vec) -> None:
        """Takes back the share `slip` of the sideways motion of points (3, N), which stay on the tool's surface."""
        R0, t0 = _single(self.model.X_XC)
        back = np.float32(self.slip) * (R0 @ self.points.p + t0 - moved)
        n = R @ self.points.n
        moved[:2] += back[:2]
        moved[2] -= (n[0] * back[0] + n[1] * back[1]) / n[2]

    def locked(self) -> float:
        """Share of the reference image that the motion explains; 0 where most of it is out of view."""
        value, w, r = self.points.value, self.image.w, self.image.r
        if value.size < FEW:
            return 0.0
        energy, total = float(value @ (w * value)), float(value @ value)
        share = 1.0 - float(r @ (w * r)) / energy if energy > 0.0 else 0.0
        return share * min(1.0, 4.0 * energy / max(total, 1e-9))


def _touching(model: FingerModel, p: Vec, n: Vec, X_XT: Array) -> NDArray[np.intp]:
    """Indices of the points (3, N) with normals (3, N) that lie on the tool when it is at X_XT."""
    R, t = _single(X_XT)
    P = R @ p + t
    return np.flatnonzero(touches(sample(model.rest, project32(model.camera, P)), P[2], R @ n, model.decay))


def _single(X: Array) -> tuple[Vec, Vec]:
    """R (3, 3) and p (3, 1) in single precision."""
    return X[:3, :3].astype(np.float32), X[:3, 3:].astype(np.float32)
