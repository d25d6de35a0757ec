# SPDX-License-Identifier: Apache-2.0
"""How far the tool has slid on the membranes since the grasp, from what depth and markers contradict each other by.

Markers show where the membranes' material is, depth where the tool is. The rigid fit joins both, and follows the
markers, which are far more exact. A patch that has slid as a whole still looks as it did: no residual tells that the
tool is elsewhere. But depth goes on telling so, roughly in one frame and well over some:

    markers' motion  =  tool's motion  o  exp(s)          s = [rotation, translation] in the tool's frame

s is a random walk along the way that the patches go, as wide in what depth does not see (a cylinder along and about
its own axis) as in what it sees. It is corrected in what depth sees only; there is no telling the rest, so the pose
stays with the markers there, and its covariance grows. The frames themselves decide how fast s walks: Kalman filters of
several rates run side by side, the first of which takes the tool for sticking, and count by how well they foretell what
comes (multiple-model estimation; Magill 1965). So a tool that sticks keeps the exactness of its markers.

Not all that depth seems to tell is true. Errors of its normals look like information about motions along the surface,
errors of the cameras like a slide, and a membrane does not go with a thin tool as one body.
"""

from collections.abc import Sequence

import numpy as np

from seed_core.spatial import Array, inverse_pose, make_pose, skew, so3_exp
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.micro_slip import MicroSlip
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import motion_vector

# Chosen on membranes 101 to 105 and 6200 to 6204; docs/estimation_figures.md has the outcome on others
SHARE = 0.5  # [1] of the patches' way by which the tool slides
ALIKE_WAY = 0.002  # [m] of way with one and the same share
RATES = np.array((0.0, 1 / 64, 1 / 8, 1.0))  # of that variance, by filter
LESS_LIKELY = 2.0  # logarithm of how much likelier it is, before anything is seen, that a tool sticks
FARTHEST = 0.004  # [m] deviation of a slide of which nothing is seen
MEMORY = 2.0  # [s] for which frames tell how fast it slides; a pause forgets nothing
DOUBT = 0.4  # [1] of the logarithm of a likelihood that counts: frames are not independent
# [rad] error of a normal; how many times the information that such errors pretend counts half, and how steeply
NORMALS, PRETENDED, STEEP = 0.017, 25.0, 6
USUAL, SMOOTH = 2.0, 0.05  # times its noise by which cells of depth contradict each other, and weight of a frame in it
UNFIT = 0.3  # [1] of what they do so beyond that which stays alike for a while
ERRS = 0.01, 2.0e-5  # [1] of the motion since the grasp, and [m], by which depth errs for a while
ALIKE = 0.25  # [s] for which it does, and errors of cameras count
REACH = 0.006  # [m] of a patch about its middle
HELD = 100.0  # [1/m] one over the deviation of what neither markers nor depth see
LEAST_WEIGHT, LEAST = 1e-12, 1e-3  # of a filter; of information, in what is pretended
_EYE = np.eye(6)


class Sliding:
    """Of one grasp."""

    def __init__(self) -> None:
        self._lever = np.ones(6)  # [m/rad, 1] from a motion to displacements of the patches
        self._walk = np.zeros(6)
        n = len(RATES)
        self._s, self._P = np.zeros((n, 6)), np.zeros((n, 6, 6))  # of each filter, in displacements [m]
        self._start = np.where(RATES > 0.0, -LESS_LIKELY, 0.0)
        self._likely, self._weight = self._start, np.exp(self._start) / np.exp(self._start).sum()
        self._pretends: dict[str, Array] = {}  # by finger, (6, 6) of errors of normals, of information 1
        self._X, self._stamp = np.eye(4), -np.inf
        self._by_cameras = np.zeros((6, 6))
        self._scatter: Array | None = None  # (6, 6) [m^2] of depth beyond its noise, averaged

    def _begin(self, models: Sequence[FingerModel], stamp: float) -> None:
        apart = float(np.mean([abs(m.p[1].mean()) for m in models]))  # [m] of the patches from the tool's axis
        across = max(apart, 1e-3)
        self._lever = np.array((across, REACH, across, 1.0, 1.0, 1.0))
        # each patch slides along x and z and turns about y; both together turn the tool about all axes
        of_turn = 0.0 if len(models) == 1 else 1.0
        self._walk = np.array((of_turn, 1.0, of_turn, 1.0, 0.0, 1.0)) / len(models)
        self._pretends = {m.finger: _pretended(m.p.astype(float)) for m in models}
        self._stamp = stamp

    def update(
        self, fit: Fit, stamp: float, slip: MicroSlip, scatter: Array, by_error: tuple[Array, Array], errors: Array
    ) -> None:
        """Takes a fit that is believed, of images of time `stamp` [s].

        slip: after it; scatter: (6, 6) of its depth images, as of `Residuals.scatter`; by_error: change of its
        gradients with errors of the cameras, as of `Systematic.gradients`; errors (n, n): their covariance.
        """
        if not stamp > self._stamp > -np.inf:
            self._begin([f.model for f in fit.fingers], stamp)
        dt, self._stamp = max(stamp - self._stamp, 1e-3), stamp
        told, noise, in_seen = self._told(fit, dt, slip, scatter, by_error, errors)
        # the tool slides; what nothing tells of fades
        walk = SHARE**2 * ALIKE_WAY * self._moved(fit.X_CT) * self._walk
        stays = np.exp(-0.5 * RATES[:, None] * walk / FARTHEST**2)
        s = stays * self._s
        P = stays[:, :, None] * self._P * stays[:, None, :] + RATES[:, None, None] * np.diag(walk)
        # corrected in what depth sees only; by Joseph's form, because that gain is not the optimal one
        root = np.linalg.inv(np.linalg.cholesky(P + noise))
        gain = in_seen @ P @ root.transpose(0, 2, 1) @ root
        off = told - s
        self._s = s + np.einsum("nij,nj->ni", gain, off)
        left = _EYE - gain
        P = left @ P @ left.transpose(0, 2, 1) + gain @ noise @ gain.transpose(0, 2, 1)
        self._P = 0.5 * (P + P.transpose(0, 2, 1))
        # how well each filter foretold this frame
        white = np.einsum("nij,nj->ni", root, off)
        likely = np.log(np.einsum("nii->ni", root)).sum(axis=1) - 0.5 * np.square(white).sum(axis=1)
        likely = self._start + np.exp(-min(dt, ALIKE) / MEMORY) * (self._likely - self._start) + DOUBT * likely
        weight = np.exp(likely - likely.max())
        self._weight = weight / weight.sum()
        self._likely = np.log(np.maximum(self._weight, LEAST_WEIGHT))

    def _told(
        self, fit: Fit, dt: float, slip: MicroSlip, scatter: Array, by_error: tuple[Array, Array], errors: Array
    ) -> tuple[Array, Array, Array]:
        """s as depth and markers of one frame tell it, in displacements (6,) [m], and how far that is to be trusted.

        Returns:
            s, its covariance (6, 6), and the projection (6, 6) on what depth sees.
        """
        scale = 1.0 / self._lever
        unit = np.outer(scale, scale)
        by_image = np.linalg.inv((fit.H - fit.H_depth) * unit + HELD**2 * _EYE)
        # depth pretends to see all: a normal that errs looks as if it told of motions along the surface
        information, directions = np.linalg.eigh(fit.H_depth * unit)
        by_normals = sum(np.trace(f.depth.H[3:, 3:]) * self._pretends[f.model.finger] for f in fit.fingers)
        pretended = np.einsum("ij,ij->j", directions, (by_normals * unit + HELD**2 * _EYE) @ directions)
        information = np.maximum(information, 0.0) + LEAST * pretended
        seen = 1.0 / (1.0 + (PRETENDED * pretended / information) ** STEEP)
        by_depth = (directions / information) @ directions.T
        s = self._lever * fit.ahead + by_depth @ (scale * fit.g_depth) - by_image @ (scale * (fit.g - fit.g_depth))
        # where the membrane's shape does not go with the tool (thin ones), cells of depth contradict each other more
        more = by_depth @ (unit * (scatter - USUAL * fit.H_depth)) @ by_depth
        self._scatter = more if self._scatter is None else self._scatter + SMOOTH * (more - self._scatter)
        noise = by_image + (directions / (information * seen + LEAST * pretended)) @ directions.T
        # errors that stay alike for a while
        D = by_image @ (scale[:, None] * by_error[0]) - by_depth @ (scale[:, None] * by_error[1])
        self._by_cameras = D @ errors @ D.T
        size = self._lever * motion_vector(fit.X_CT)
        of_slip = self._lever * fit.slip_information.effect
        alike = self._by_cameras + (ERRS[0] ** 2 * float(size @ size) + ERRS[1] ** 2) * _EYE
        alike += UNFIT * _positive(self._scatter) + slip.deviation**2 * np.outer(of_slip, of_slip)
        noise += max(ALIKE / dt, 1.0) * alike
        return s, noise, (directions * seen) @ directions.T

    @property
    def value(self) -> Array:
        """s (6,) [rad, m]."""
        return np.asarray(self._weight @ self._s / self._lever)

    def of_pose(self, fit: Fit) -> tuple[Array, Array]:
        """Where the tool is from where the fit has its patches.

        Returns:
            X_PT (4, 4), and its covariance (6, 6) of [rotation, translation] in the tool's frame.
        """
        apart = self._s - self._weight @ self._s
        P = np.tensordot(self._weight, self._P + apart[:, :, None] * apart[:, None, :], 1)
        P += (1.0 - self._weight[0]) * self._by_cameras
        E = -np.linalg.solve(fit.H, fit.H - fit.H_depth) / self._lever
        more = E @ (self._lever * (self.value - fit.ahead))
        X_PT = make_pose(so3_exp(-fit.ahead[:3]), -fit.ahead[3:]) @ make_pose(so3_exp(more[:3]), more[3:])
        return X_PT, E @ P @ E.T

    def _moved(self, X_CT: Array) -> float:
        """Way [m] along the membranes since the last fit."""
        step = self._lever * motion_vector(inverse_pose(self._X) @ X_CT)
        self._X = X_CT
        return float(np.sqrt(np.square(step[[0, 1, 2, 3, 5]]).sum()))


def _positive(C: Array) -> Array:
    """The part of a symmetric matrix (6, 6) that is a covariance."""
    values, vectors = np.linalg.eigh(C)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _pretended(p: Array) -> Array:
    """(6, 6) information about a motion that errors of normals at points p (3, N) pretend, of each one of depth."""
    out = np.zeros((6, 6))
    crossed = np.array([skew(x) for x in p.T])
    out[:3, :3] = (crossed @ crossed.transpose(0, 2, 1)).mean(axis=0)
    out[:3, 3:] = crossed.mean(axis=0)
    out[3:, :3] = out[:3, 3:].T
    out[3:, 3:] = np.eye(3)
    return NORMALS**2 * out
