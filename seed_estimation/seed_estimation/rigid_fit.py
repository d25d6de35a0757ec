# SPDX-License-Identifier: Apache-2.0
"""One rigid motion of the tool that explains the infrared images and the depth of both fingers at once.

Robust Gauss-Newton over xi = [rotation, translation], with the residuals of `finger_model`, coarse then fine. The
membrane may follow only a share 1 - slip of the motion across the camera's axis (micro-slip), which the image sees and
depth does not; that share's own information is returned, for `slip` to learn from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seed_core.spatial import inverse_pose, orthonormalised, so3_exp, so3_log
from seed_estimation.camera import Array
from seed_estimation.finger_model import FingerModel, Vec
from seed_estimation.frame import Frame, project32, sample

ROBUST = 2.0  # residuals of this many deviations weigh half (Cauchy)
SHARE_IMAGE = 1.0 / 6.0  # neighbouring residuals are not independent: a blurred dot covers about six pixels
SHARE_DEPTH = 1.0 / 3.0  # depth is averaged over 3 x 3 pixels and read at about every second one
DEPTH_FLOOR = 1.0e-4  # [m] what a depth image gets wrong in common, however still it is
IMAGE_FLOOR = 0.05  # [1] the same of a normalised image
DONE_ROTATION, DONE_TRANSLATION = 1e-4, 5e-6  # [rad], [m] a smaller step is the last: it is a tenth of the noise
ONE = np.float32(1.0)


@dataclass(frozen=True, eq=False)
class Fit:
    """Outcome of the fit.

    Attributes:
        X_CT: (4, 4).
        H_image, H_depth: (6, 6) information of either kind about xi, in the tool's frame.
        g_image, g_depth: (6,) where either kind would like to go: H^-1 g is its own step.
        locked: share of each finger's image that the motion explains, 1 - sum w r^2 / sum w I_0^2.
        depth_rms: robust deviation of the depth residuals of each finger [m].
        slip_step, slip_information: by how much the images ask to change the slip, and how sure they are.
        iterations: Gauss-Newton steps made.
    """

    X_CT: Array
    H_image: Array
    H_depth: Array
    g_image: Array
    g_depth: Array
    locked: Mapping[str, float]
    depth_rms: Mapping[str, float]
    slip_step: float
    slip_information: float
    iterations: int


class _Block:
    """Residuals r (N,) with weights and Jacobian (6, N) of one image; the scale of the noise is kept once found."""

    def __init__(self, model: FingerModel, J: Vec, share: float, floor: float) -> None:
        self.model, self.J, self.share, self.floor = model, J, share, floor
        self.deviation = 0.0
        self.r = self.w = self.Jw = np.zeros(0, np.float32)
        self.H, self.g = np.zeros((6, 6)), np.zeros(6)

    def weigh(self, r: Vec, rescale: bool) -> None:
        """Cauchy weights, information H (6, 6) and gradient g (6,); what is not seen is far out and weighs nothing."""
        if rescale or self.deviation == 0.0:
            self.deviation = max(1.4826 * float(np.partition(np.abs(r), r.size // 2)[r.size // 2]), self.floor)
        scaled = r * np.float32(1.0 / (ROBUST * self.deviation))
        self.w = ONE / (ONE + scaled * scaled)
        self.r, self.Jw = r, self.J * self.w
        scale = self.share / self.deviation**2
        self.H = (self.Jw @ self.J.T).astype(float) * scale
        self.g = (self.Jw @ r).astype(float) * scale


class _ImageBlock(_Block):
    def __init__(self, model: FingerModel, frame: Frame, slip: float, level: int) -> None:
        self.points, self.slip, self.frame = model.levels[level], slip, frame
        self.image = frame.fine if level else frame.coarse
        super().__init__(model, self.points.jacobian(slip), SHARE_IMAGE, IMAGE_FLOOR)

    def evaluate(self, X_CT: Array, rescale: bool) -> None:
        pixels = project32(self.model.camera, self._warped(X_CT))
        self.weigh(sample(self.image, pixels, self.frame.origin) - self.points.value, rescale)

    def _warped(self, X_CT: Array) -> Vec:
        """Where the membrane's points are now (3, N), in the optical frame."""
        X_XC, points = self.model.X_XC, self.points
        R, t = _single(X_XC @ X_CT)
        moved = R @ points.p + t
        if self.slip > 0.0:
            R0, t0 = _single(X_XC)
            back = np.float32(self.slip) * (R0 @ points.p + t0 - moved)
            n = R @ points.n
            moved[:2] += back[:2]
            moved[2] -= (n[0] * back[0] + n[1] * back[1]) / n[2]  # stays on the tool's surface
        return moved

    def locked(self) -> float:
        """Share of the reference image that the motion explains; 0 where most of it is out of view."""
        value = self.points.value
        energy = float(value @ (self.w * value))
        total = float(value @ value)
        share = 1.0 - float(self.r @ (self.w * self.r)) / energy if energy > 0.0 else 0.0
        return share * min(1.0, 4.0 * energy / max(total, 1e-9))


class _DepthBlock(_Block):
    def __init__(self, model: FingerModel, frame: Frame) -> None:
        self.frame = frame
        super().__init__(model, model.J, SHARE_DEPTH, DEPTH_FLOOR)

    def evaluate(self, X_CT: Array, rescale: bool) -> None:
        m = self.model
        X_XT = m.X_XC @ X_CT
        R, t = _single(X_XT)
        P = R @ m.p + t
        eye = inverse_pose(X_XT)[:3, 3].astype(np.float32)  # the camera in the tool's frame
        z = sample(self.frame.depth, project32(m.camera, P), self.frame.origin)
        self.weigh((ONE - z / P[2]) * (m.n_p - eye @ m.n), rescale)


def _single(X: Array) -> tuple[Vec, Vec]:
    """R (3, 3) and p (3, 1) in single precision."""
    return X[:3, :3].astype(np.float32), X[:3, 3:].astype(np.float32)


def motion_vector(X: Array) -> Array:
    """[rotation vector, translation] (6,) of a pose."""
    return np.concatenate([so3_log(X[:3, :3]), X[:3, 3]])


def composed(X_CT: Array, xi: Array) -> Array:
    """X_CT exp(xi)^-1."""
    R = so3_exp(xi[:3]).T
    step = np.eye(4)
    step[:3, :3] = R
    step[:3, 3] = -R @ xi[3:]
    return np.asarray(X_CT @ step)


def fit(
    models: Sequence[FingerModel],
    frames: Mapping[str, Frame],
    X_CT: Array,
    slip: float,
    prior: Array,
    steps: tuple[int, int],
) -> Fit:
    """Pose of the tool from the fingers' frames, started at X_CT (4, 4).

    prior: (6, 6) information that holds unobserved axes where they start; steps: most steps, coarse and fine.
    """
    X, count = X_CT, 0
    depth = [_DepthBlock(m, frames[m.finger]) for m in models]
    image = [_ImageBlock(m, frames[m.finger], slip, 1) for m in models]
    if steps[0] > 0:
        low = [_ImageBlock(m, frames[m.finger], slip, 0) for m in models]
        X, count = _descend([*low, *depth], X, prior, steps[0])
    X, fine = _descend([*image, *depth], X, prior, steps[1])
    return _summary(image, depth, orthonormalised(X), prior, count + fine)


def _descend(blocks: Sequence[_ImageBlock | _DepthBlock], X: Array, prior: Array, steps: int) -> tuple[Array, int]:
    for i in range(steps):
        H, g = prior.copy(), np.zeros(6)
        for block in blocks:
            block.evaluate(X, rescale=i < 2)
            H += block.H
            g += block.g
        xi = np.asarray(np.linalg.solve(H, g), float)
        X = composed(X, xi)
        if np.abs(xi[:3]).max() < DONE_ROTATION and np.abs(xi[3:]).max() < DONE_TRANSLATION:
            break
    return X, i + 1


def _summary(image: Sequence[_ImageBlock], depth: Sequence[_DepthBlock], X: Array, prior: Array, count: int) -> Fit:
    """Information of image, depth and slip from the last evaluation."""
    motion = motion_vector(X).astype(np.float32)
    H_image, g_image = sum((b.H for b in image), np.zeros((6, 6))), sum((b.g for b in image), np.zeros(6))
    H_depth, g_depth = sum((b.H for b in depth), np.zeros((6, 6))), sum((b.g for b in depth), np.zeros(6))
    H_s, H_ss, g_s = np.zeros(6), 0.0, 0.0
    for b in image:
        column = motion @ b.points.J_along  # d r / d slip: what the motion does sideways
        scale = b.share / b.deviation**2
        H_s += scale * (b.Jw @ column).astype(float)
        H_ss += scale * float(column @ (b.w * column))
        g_s += scale * float(column @ (b.w * b.r))
    solved = np.linalg.solve(H_image + H_depth + prior, np.column_stack((H_s, g_image + g_depth)))
    information = max(H_ss - float(H_s @ solved[:, 0]), 0.0)
    return Fit(
        X_CT=X,
        H_image=H_image,
        H_depth=H_depth,
        g_image=g_image,
        g_depth=g_depth,
        locked={b.model.finger: b.locked() for b in image},
        depth_rms={b.model.finger: b.deviation for b in depth},
        slip_step=(g_s - float(H_s @ solved[:, 1])) / max(information, 1e-9),
        slip_information=information,
        iterations=count,
    )
