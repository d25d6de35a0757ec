# SPDX-License-Identifier: Apache-2.0
"""What one finger saw at the moment of grasp, prepared for alignment: points, normals, grey values and Jacobians.

The tool is followed against this one reference, which never changes: nothing drifts. A point p of the membrane in
contact moves with the tool, X_CT p. Both residuals are linearised once, in the tool's frame at the grasp (inverse
composition: X_CT <- X_CT exp(xi)^-1, xi = [rotation, translation]), so a frame costs sampling and small products only:

    image   r = I_t(pi(X_XC X_CT p)) - I_0(u)           J = grad I_0 . d pi . [-[p]x, 1]
    depth   r = n . (p - q), q the measured point on the ray through X_CT p, taken back to the tool; J = [p x n, n]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose
from seed_estimation.contact.patch import Mask
from seed_estimation.contact.surface import Vec, surface, touches
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.normalise import coarse, normalised
from seed_estimation.images.tactile_images import Image
from seed_estimation.parameters import EstimatorParameters

Cells = NDArray[np.intp]
CELL = 16  # [px] side of the pieces of a patch whose errors count as independent: two dots and more
SURFACE_BLUR = 2.5  # [px] of the depth image before its slope is taken


@dataclass(frozen=True, eq=False)
class ImagePoints:
    """Infrared pixels followed at one level: values (N,) and Jacobian (6, N) in two parts.

    Sideways motion, across the camera's axis, is what the membrane may fail to follow; the rest it cannot but follow.
    """

    p: Vec  # (3, N) in the tool's frame [m]
    n: Vec  # (3, N) unit normals, in the tool's frame
    value: Vec
    J_along: Vec
    J_rest: Vec
    cells: Cells  # (N,) number of the piece of the patch that it lies in, rising

    def chosen(self, index: Cells) -> ImagePoints:
        """Those of the given indices, rising."""
        if index.size == self.value.size:
            return self
        J_along, J_rest = self.J_along.take(index, axis=1), self.J_rest.take(index, axis=1)
        p, n = self.p.take(index, axis=1), self.n.take(index, axis=1)
        return ImagePoints(p, n, self.value[index], J_along, J_rest, self.cells[index])

    def jacobian(self, slip: float) -> Vec:
        """(6, N) when the membrane follows a share 1 - slip of the sideways motion."""
        return self.J_along * np.float32(1.0 - slip) + self.J_rest


@dataclass(frozen=True, eq=False)
class FingerModel:
    """One finger at the moment of grasp; C and T coincide."""

    finger: str
    camera: PinholeCamera
    X_XC: Array  # pose of C in the optical frame
    levels: tuple[ImagePoints, ImagePoints]  # coarse, fine
    p: Vec  # (3, M) depth pixels in the tool's frame [m]
    n: Vec  # (3, M) unit normals towards the camera
    n_p: Vec  # (M,) n . p
    J: Vec  # (6, M) of the depth residual
    cells: Cells  # (M,) as of the image's points
    rest: Image  # (H, W, 3) depth of the membrane at rest [m], its slope to the right and downwards [1]
    decay: float  # [m]
    picture: Image  # (H, W) coarse infrared of the patch, 0 beside it

    def without_image(self) -> FingerModel:
        """The same of which depth alone is followed."""
        coarse, fine = (i.chosen(np.zeros(0, np.intp)) for i in self.levels)
        return replace(self, levels=(coarse, fine))

    @cached_property
    def surfaces(self) -> tuple[tuple[Vec, Vec], tuple[Vec, Vec]]:
        """Points and normals (3, N + M) of each level's image and of depth, in that order."""
        coarse, fine = (
            (np.concatenate((i.p, self.p), axis=1), np.concatenate((i.n, self.n), axis=1)) for i in self.levels
        )
        return coarse, fine


def build(
    finger: str,
    camera: PinholeCamera,
    X_CX: Array,
    rest: Image,
    depth: Image,
    ir: Image,
    mask: Mask,
    p: EstimatorParameters,
) -> FingerModel | None:
    """The model from the membrane at rest (H, W, 3), mean depth of the grasp (H, W) [m], infrared [counts], contact.

    None when the patch is too small.
    """
    # beyond the patch's edge the surface is another one: it must not leak in
    valid = np.isfinite(depth) & (depth > p.near) & (depth < p.far) & (mask > 0)
    points, normals = surface(camera, depth, valid, SURFACE_BLUR)
    known = np.isfinite(normals).all(axis=2) & np.isfinite(points).all(axis=2)
    stuck = touches(rest.reshape(-1, 3), points[..., 2].ravel(), normals.reshape(-1, 3).T, p.decay)
    good = eroded(mask, p.erosion) & known & stuck.reshape(mask.shape)
    if np.count_nonzero(good) < p.least_area // 3:
        return None
    v, u = _by_cell(*_spread(good, p.depth_points))
    P, n = _in_hand(points[v, u], normals[v, u], X_CX)
    blurred = coarse(ir)
    levels = (
        _image_points(blurred, good, points, normals, camera, X_CX, p.image_points // 2),
        _image_points(normalised(ir), good, points, normals, camera, X_CX, p.image_points),
    )
    return FingerModel(
        finger, camera, inverse_pose(X_CX), levels, _rows(P), _rows(n), (n * P).sum(axis=1), _motion(P, n),
        _cell(v, u), rest, p.decay, np.where(good, blurred, np.float32(0.0)),
    )  # fmt: skip


def _cell(v: Cells, u: Cells) -> Cells:
    """Number of the piece of the patch in which each pixel lies."""
    return (v // CELL) * 256 + u // CELL


def _by_cell(v: Cells, u: Cells) -> tuple[Cells, Cells]:
    """Pixels sorted by the piece in which they lie."""
    order = np.argsort(_cell(v, u), kind="stable")
    return v[order], u[order]


def _rows(values: Vec) -> Vec:
    """(N, 3) as contiguous (3, N): one pass per coordinate is what a frame's arithmetic costs."""
    return np.ascontiguousarray(values.T, dtype=np.float32)


def eroded(mask: Mask, width: int) -> NDArray[np.bool_]:
    """The mask without a border of the given width; less when nothing much would be left."""
    while width > 0:
        side = 2 * width + 1
        inner = cv2.erode(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), borderValue=0)
        if np.count_nonzero(inner) > 0.3 * np.count_nonzero(mask):
            return np.asarray(inner > 0)
        width -= 1
    return np.asarray(mask > 0)


def _spread(good: NDArray[np.bool_], wanted: int) -> tuple[Cells, Cells]:
    """At most `wanted` pixels, spread evenly over the mask."""
    v, u = np.nonzero(good)
    keep = np.unique(np.linspace(0, v.size - 1, min(wanted, v.size)).astype(int))
    return v[keep], u[keep]


def _in_hand(points: Vec, normals: Vec, X_CX: Array) -> tuple[Vec, Vec]:
    R = X_CX[:3, :3].astype(np.float32)
    return points @ R.T + X_CX[:3, 3].astype(np.float32), normals @ R.T


def _image_points(
    image: Image, good: NDArray[np.bool_], points: Vec, normals: Vec, camera: PinholeCamera, X_CX: Array, wanted: int
) -> ImagePoints:
    """The pixels of strongest gradient: they tell the motion best."""
    gx = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)
    gy = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)
    strength = np.where(good, gx * gx + gy * gy, -1.0)
    count = min(wanted, int(np.count_nonzero(good)))
    best = np.argpartition(strength.ravel(), -count)[-count:]
    v, u = _by_cell(*np.unravel_index(best, image.shape))
    P_X, n_X = points[v, u], normals[v, u]
    P, n = _in_hand(P_X, n_X, X_CX)
    gradient = np.stack((gx[v, u], gy[v, u]), axis=1)
    slope = gradient_in_space(camera, P_X, gradient)
    along = slope - slope[:, 2:] / n_X[:, 2:] * n_X  # what sideways motion changes while the point stays on the surface
    R_XC = inverse_pose(X_CX)[:3, :3].astype(np.float32)
    along, slope = along @ R_XC, slope @ R_XC
    return ImagePoints(_rows(P), _rows(n), image[v, u], _motion(P, along), _motion(P, slope - along), _cell(v, u))


def gradient_in_space(camera: PinholeCamera, P_X: Vec, gradient: Vec) -> Vec:
    """d I / d P (N, 3) [1/m] from the image's gradient (N, 2) [1/px], at points P_X (N, 3) of the optical frame."""
    step = 1e-5  # [m]
    out = np.empty_like(P_X)
    for axis in range(3):
        d = np.zeros(3)
        d[axis] = step
        pixels = (camera.project(P_X.astype(float) + d) - camera.project(P_X.astype(float) - d)) / (2.0 * step)
        out[:, axis] = (gradient * pixels).sum(axis=1)
    return out


def _motion(P: Vec, slope: Vec) -> Vec:
    """(6, N) change of value with [rotation, translation] of points P (N, 3), from d value / d P (N, 3)."""
    return _rows(np.hstack((np.cross(P, slope), slope)))
