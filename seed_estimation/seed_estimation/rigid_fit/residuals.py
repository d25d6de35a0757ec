# SPDX-License-Identifier: Apache-2.0
"""Residuals of one finger's points in one frame, their robust weights, and the information that they carry.

Weights are Cauchy's. Neighbouring residuals are not independent, so the information that they claim is worth little by
itself; `scatter` says how far parts of the patch contradict each other, which is what covariance is made of.
"""

import numpy as np
from scipy.linalg.lapack import dposv

from seed_core.spatial import Array, inverse_pose, so3_log
from seed_estimation.contact.surface import lies_on_tool
from seed_estimation.images.sampling import Crop, sample
from seed_estimation.images.tactile_images import Array32
from seed_estimation.rigid_fit.reference import FingerModel, Indices

ROBUST = 2.0  # residuals of this many deviations weigh half (Cauchy)
SHARE_IMAGE = 1.0 / 6.0  # neighbouring residuals are not independent: a blurred marker covers about six pixels
SHARE_DEPTH = 1.0 / 3.0  # depth is averaged over 3 x 3 pixels and read at about every second one
DEPTH_FLOOR = 1.0e-4  # [m] what a depth image gets wrong in common, however still it is
DEPTH_COMMON = 6.0e-5  # [m] of it, what a whole patch gets wrong by one and the same amount
IMAGE_FLOOR = 0.05  # [1] the same of a normalised image
UNKNOWNS = 6  # of a pose
FEW = 60  # points; fewer that touch tell nothing
ONE = np.float32(1.0)


def solved(H: Array, g: Array) -> Array:
    """x (N,) of H x = g by Cholesky, for a quarter of what numpy's general solver costs at N = 6.

    Raises:
        numpy.linalg.LinAlgError: H (N, N) is not positive definite.
    """
    _, x, info = dposv(H, g)
    if info:
        raise np.linalg.LinAlgError("the information matrix is not positive definite")
    return np.asarray(x)


def motion_vector(X: Array) -> Array:
    """[rotation vector, translation] (6,) of a pose (4, 4)."""
    return np.concatenate([so3_log(X[:3, :3]), X[:3, 3]])


class Residuals:
    """Residuals of the infrared or of the depth image of one finger, linear in xi = [rotation, translation].

    Attributes:
        r, w: (N,) residuals and weights; empty where too few points touch.
        Jw: (6, N) weighted Jacobian.
        deviation: robust deviation of the residuals.
        H, g: (6, 6) information about xi, and (6,) gradient.
    """

    def __init__(self, J: Array32, cells: Indices, share: float, floor: float, common: float = 0.0) -> None:
        """J: (6, N) Jacobian; cells: (N,) number of the piece of the patch that each lies in, rising.

        share: of the residuals that counts as independent; floor: least deviation; common: of what a patch gets wrong
        alike.
        """
        self.J, self.cells, self.share, self.floor, self.common = J, cells, share, floor, common
        self.deviation = floor
        self.r = self.w = np.zeros(0, np.float32)
        self.Jw = J[:, :0]
        self.H, self.g = np.zeros((len(J), len(J))), np.zeros(len(J))

    @property
    def scale(self) -> float:
        """From weighted sums to information."""
        return self.share / self.deviation**2

    def reweight(self, r: Array32, rescale: bool) -> None:
        """Takes residuals r (N,); what is not seen is far out and weighs nothing. rescale: find the deviation anew."""
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
            return np.zeros_like(self.H)
        edges = np.flatnonzero(self.cells[1:] != self.cells[:-1]) + 1
        g = np.add.reduceat(self.Jw * self.r, np.concatenate(((0,), edges)), axis=1).astype(float) * self.scale
        alike = self.common * self.scale * self.Jw.sum(axis=1).astype(float)
        count = g.shape[1]
        few = count / max(count - UNKNOWNS, 1)  # a handful of cells is fitted better than it should be
        return np.asarray(few * (g @ g.T) + np.outer(alike, alike))


class FingerResiduals:
    """Image and depth residuals of one finger in one frame, of the points that touch the tool.

    Attributes:
        index: of the image's points that touch, among those of the model.
        points: those points of the image.
        image, depth: residuals.
        depth_points: (3, M) the points of depth that touch, in the tool's frame [m].
    """

    def __init__(
        self, model: FingerModel, crop: Crop, X_CT: Array, slip: float, level: int, X_PT: Array | None = None
    ) -> None:
        """X_CT (4, 4): about where the tool is; it decides which points touch. level: 0 coarse, 1 fine.

        X_PT (4, 4): how far the tool has slid on its patches, by which depth sees it elsewhere than the image does.
        """
        self.model, self._crop, self._slip, self._X_PT = model, crop, slip, X_PT
        self._picture = crop.fine if level else crop.coarse
        points = model.levels[level]
        p, n = model.surfaces[level]
        R, t = _single(model.X_XC @ X_CT)
        P = R @ p + t
        rest = sample(model.rest, model.camera.project32(P))
        touching = np.flatnonzero(lies_on_tool(rest, P[2], R @ n, model.decay))
        first = int(np.searchsorted(touching, points.value.size))
        d = touching[first:] - points.value.size
        self.index = touching[:first]
        self.points, self._p = points.chosen(self.index), p.take(touching, axis=1)
        self.depth_points = self._p[:, first:]
        self._n, self._n_p = model.n.take(d, axis=1), model.n_p[d]
        self.image = Residuals(self.points.jacobian(slip), self.points.cells, SHARE_IMAGE, IMAGE_FLOOR)
        self.depth = Residuals(model.J.take(d, axis=1), model.cells[d], SHARE_DEPTH, DEPTH_FLOOR, DEPTH_COMMON)

    def evaluate(self, X_CT: Array, rescale: bool) -> None:
        """Residuals, weights and information at a pose (4, 4)."""
        X_XT, count = self.model.X_XC @ X_CT, self.points.value.size
        R, t = _single(X_XT)
        P = R @ self._p + t
        if self._X_PT is not None:
            X_XT = X_XT @ self._X_PT
            R_slid, t_slid = _single(X_XT)
            P[:, count:] = R_slid @ self._p[:, count:] + t_slid
        if self._slip > 0.0:
            self._leave_behind(P[:, :count], R)
        pixels = self.model.camera.project32(P)
        pixels -= np.array(self._crop.origin, np.float32)[:, None]
        self.image.reweight(sample(self._picture, pixels[:, :count]) - self.points.value, rescale)
        eye = inverse_pose(X_XT)[:3, 3].astype(np.float32)  # the camera in the tool's frame
        z = sample(self._crop.depth, pixels[:, count:])
        self.depth.reweight((ONE - z / P[2, count:]) * (self._n_p - eye @ self._n), rescale)

    def _leave_behind(self, moved: Array32, R: Array32) -> None:
        """Takes back the share `slip` of the sideways motion of points (3, N), which stay on the tool's surface."""
        R0, t0 = _single(self.model.X_XC)
        back = np.float32(self._slip) * (R0 @ self.points.p + t0 - moved)
        n = R @ self.points.n
        moved[:2] += back[:2]
        moved[2] -= (n[0] * back[0] + n[1] * back[1]) / n[2]

    def explained(self) -> float:
        """Share of the reference image that the motion explains, 1 - sum w r^2 / sum w I_0^2.

        0 where most of it is out of view.
        """
        value, w, r = self.points.value, self.image.w, self.image.r
        if value.size < FEW:
            return 0.0
        energy, total = float(value @ (w * value)), float(value @ value)
        share = 1.0 - float(r @ (w * r)) / energy if energy > 0.0 else 0.0
        return share * min(1.0, 4.0 * energy / max(total, 1e-9))


def _single(X: Array) -> tuple[Array32, Array32]:
    """R (3, 3) and p (3, 1) in single precision."""
    return X[:3, :3].astype(np.float32), X[:3, 3:].astype(np.float32)
