# SPDX-License-Identifier: Apache-2.0
"""What one finger saw at the moment of grasp, prepared for alignment: points, normals, grey values and Jacobians.

The tool is followed against this one reference, which never changes: nothing drifts. A point p of the membrane in
contact moves with the tool, X_CT p. Both residuals are linearised once, in the tool's frame at the grasp (inverse
composition: X_CT <- X_CT exp(xi)^-1, xi = [rotation, translation]), so a frame costs sampling and small products only:

    image   r = I_t(pi(X_XC X_CT p)) - I_0(u)           J = grad I_0 . d pi . [-[p]x, 1]
    depth   r = n . (p - q), q the measured point on the ray through X_CT p, taken back to the tool; J = [p x n, n]
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import inverse_pose
from seed_estimation.camera import Array, Camera
from seed_estimation.contact_patch import Mask
from seed_estimation.images import Image
from seed_estimation.normalise import coarse
from seed_estimation.parameters import EstimatorParameters

Vec = NDArray[np.float32]
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

    def jacobian(self, slip: float) -> Vec:
        """(6, N) when the membrane follows a share 1 - slip of the sideways motion."""
        return self.J_along * np.float32(1.0 - slip) + self.J_rest


@dataclass(frozen=True, eq=False)
class FingerModel:
    """One finger at the moment of grasp; C and T coincide."""

    finger: str
    camera: Camera
    X_XC: Array  # pose of C in the optical frame
    levels: tuple[ImagePoints, ImagePoints]  # coarse, fine
    p: Vec  # (3, M) depth pixels in the tool's frame [m]
    n: Vec  # (3, M) unit normals towards the camera
    n_p: Vec  # (M,) n . p
    J: Vec  # (6, M) of the depth residual
    box: tuple[int, int, int, int]  # first and last u, first and last v of the pixels [px]


def smooth_depth(depth: Image, valid: NDArray[np.bool_], sigma: float) -> Image:
    """Depth blurred over its valid pixels only (normalised convolution)."""
    weight = cv2.GaussianBlur(valid.astype(np.float32), (0, 0), sigma)
    blurred = cv2.GaussianBlur(np.where(valid, depth, np.float32(0.0)), (0, 0), sigma)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0.2, blurred / weight, np.nan).astype(np.float32)


def surface_normals(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit normals (H, W, 3) towards the camera of a grid of points (H, W, 3) in the optical frame."""
    du = cv2.Sobel(points, cv2.CV_32F, 1, 0)
    dv = cv2.Sobel(points, cv2.CV_32F, 0, 1)
    normal = np.cross(dv, du)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return np.where(normal[..., 2:] > 0.0, -normal, normal).astype(np.float32)


def build(
    finger: str, camera: Camera, X_CX: Array, depth: Image, image: Image, mask: Mask, p: EstimatorParameters
) -> FingerModel | None:
    """The model from mean depth (H, W) [m], normalised infrared image and contact mask; None when it is too small."""
    # beyond the patch's edge the surface is another one: it must not leak in
    valid = np.isfinite(depth) & (depth > p.near) & (depth < p.far) & (mask > 0)
    surface = smooth_depth(depth, valid, SURFACE_BLUR)
    points = camera.rays32 * surface[..., None]
    normals = surface_normals(points)
    good = eroded(mask, p.erosion) & np.isfinite(normals).all(axis=2) & np.isfinite(points).all(axis=2)
    if np.count_nonzero(good) < p.least_area // 3:
        return None
    v, u = _choose_depth(good, p.depth_points)
    P, n = _in_hand(points[v, u], normals[v, u], X_CX)
    low = coarse(image)
    levels = (
        _image_points(low, good, points, normals, camera, X_CX, p.image_points // 2),
        _image_points(image, good, points, normals, camera, X_CX, p.image_points),
    )
    J = _motion(P, n)
    box = (int(u.min()), int(u.max()), int(v.min()), int(v.max()))
    return FingerModel(finger, camera, inverse_pose(X_CX), levels, _rows(P), _rows(n), (n * P).sum(axis=1), J, box)


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


def _choose_depth(good: NDArray[np.bool_], wanted: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """At most `wanted` pixels, spread evenly over the mask."""
    v, u = np.nonzero(good)
    keep = np.unique(np.linspace(0, v.size - 1, min(wanted, v.size)).astype(int))
    return v[keep], u[keep]


def _in_hand(points: Vec, normals: Vec, X_CX: Array) -> tuple[Vec, Vec]:
    R = X_CX[:3, :3].astype(np.float32)
    return points @ R.T + X_CX[:3, 3].astype(np.float32), normals @ R.T


def _image_points(
    image: Image, good: NDArray[np.bool_], points: Vec, normals: Vec, camera: Camera, X_CX: Array, wanted: int
) -> ImagePoints:
    """The pixels of strongest gradient: they tell the motion best."""
    gx = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)
    gy = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)
    strength = np.where(good, gx * gx + gy * gy, -1.0)
    count = min(wanted, int(np.count_nonzero(good)))
    best = np.argpartition(strength.ravel(), -count)[-count:]
    v, u = np.unravel_index(np.sort(best), image.shape)
    P_X, n_X = points[v, u], normals[v, u]
    P, n = _in_hand(P_X, n_X, X_CX)
    gradient = np.stack((gx[v, u], gy[v, u]), axis=1)
    slope = gradient_in_space(camera, P_X, gradient)
    along = slope - slope[:, 2:] / n_X[:, 2:] * n_X  # what sideways motion changes while the point stays on the surface
    R_XC = inverse_pose(X_CX)[:3, :3].astype(np.float32)
    along, slope = along @ R_XC, slope @ R_XC
    return ImagePoints(_rows(P), _rows(n), image[v, u], _motion(P, along), _motion(P, slope - along))


def gradient_in_space(camera: Camera, P_X: Vec, gradient: Vec) -> Vec:
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
