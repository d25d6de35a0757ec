# SPDX-License-Identifier: Apache-2.0
"""Surfaces seen as depth images: smoothing, normals, and the part of a membrane that lies on the tool.

Beside a tool an imprint decays by e within a length `decay` (8.5 mm on a recorded press, on every side). So the
membrane lies on the tool only where the tool's surface falls away from the membrane at rest less steeply than that:
|grad imprint| < imprint / decay. Beyond, it hangs free as a skirt, which does not move with the tool.
"""

from math import ceil

import cv2
import numpy as np

from seed_core.spatial import Array
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import NOTHING, Array32, Bools, Image

REST_BLUR = 5.0  # [px] a membrane at rest has no smaller features
REACH = 4.0  # [deviations] of a fitted parabola's weights


def smooth_depth(depth: Image, valid: Bools, sigma: float) -> Image:
    """Depth (H, W) blurred by a Gaussian [px] over its valid pixels only (normalised convolution)."""
    weight = cv2.GaussianBlur(valid.astype(np.float32), (0, 0), sigma)
    blurred = cv2.GaussianBlur(np.where(valid, depth, np.float32(0.0)), (0, 0), sigma)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0.2, blurred / weight, np.nan).astype(np.float32)


def fitted_parabolas(depth: Image, valid: Bools, sigma: float) -> Image:
    """Depth (H, W) of the parabola that fits best around each pixel, weighed by a Gaussian [px]; NaN beside `valid`.

    Local regression of second order: unlike a blur it neither flattens a dome nor lifts its rim, so it may be wide,
    and what a camera gets wrong over a centimetre is told from a membrane's shape as well as what it gets wrong pixel
    by pixel.
    """
    far = np.arange(-ceil(REACH * sigma), ceil(REACH * sigma) + 1) / sigma
    kernels = [np.exp(-0.5 * far**2) * far**i for i in range(5)]
    total = kernels[0].sum() ** 2

    def moment(image: Array, i: int, j: int) -> Array:
        """Sum over a pixel's neighbours of their values times their weights and offsets u^i v^j."""
        return np.asarray(cv2.sepFilter2D(image, cv2.CV_64F, kernels[i], kernels[j], borderType=cv2.BORDER_CONSTANT))

    powers = [(i, j) for i in range(3) for j in range(3 - i)]
    values = np.stack([moment(np.where(valid, depth, 0.0), i, j) for i, j in powers], axis=2)
    weight = valid.astype(np.float64)
    near = moment(weight, 0, 0)
    whole = valid & (near > (1.0 - 1e-6) * total)  # all neighbours are known: the same weights for all of these
    partly = valid & ~whole & (near > 0.05 * total)
    out = np.full(depth.shape, np.nan, np.float32)
    A = np.array([[kernels[a + c].sum() * kernels[b + d].sum() for c, d in powers] for a, b in powers])
    out[whole] = values[whole] @ np.linalg.inv(A)[0]
    moments = {(i, j): moment(weight, i, j)[partly] for i in range(5) for j in range(5 - i)}
    B = np.array([[moments[a + c, b + d] for c, d in powers] for a, b in powers]).transpose(2, 0, 1)
    out[partly] = np.linalg.solve(B + 1e-9 * np.eye(6), values[partly][..., None])[:, 0, 0]
    return out


def surface(camera: PinholeCamera, depth: Image, valid: Bools, blur: float) -> tuple[Array32, Array32]:
    """Points and unit normals towards the camera, (H, W, 3), of depth blurred by so many pixels; NaN where invalid."""
    points = camera.rays32 * smooth_depth(depth, valid, blur)[..., None]
    normal = np.cross(cv2.Sobel(points, cv2.CV_32F, 0, 1), cv2.Sobel(points, cv2.CV_32F, 1, 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return points, np.where(normal[..., 2:] > 0.0, -normal, normal).astype(np.float32)


def rest_surface(camera: PinholeCamera, depth: Image) -> Array32:
    """(H, W, 3) depth of the membrane at rest [m] and its slopes to the right and downwards [1]; NOTHING beside it."""
    points, normals = surface(camera, depth, np.isfinite(depth), REST_BLUR)
    with np.errstate(invalid="ignore"):
        out = np.dstack((points[..., 2], -normals[..., 0] / normals[..., 2], -normals[..., 1] / normals[..., 2]))
    out[~np.isfinite(out).all(axis=2)] = NOTHING
    return np.ascontiguousarray(out, np.float32)


def lies_on_tool(rest: Array32, z: Array32, n: Array32, decay: float) -> Bools:
    """Whether the membrane lies on a tool's surface.

    Args:
        rest: (N, 3) depth and slopes of the membrane at rest there, as `rest_surface` gives them.
        z, n: depths (N,) [m] and normals (3, N) of the tool's surface.
        decay: way beside the tool over which an imprint falls by e [m].
    """
    imprint = rest[:, 0] - z
    slope = n[:2] / n[2]
    slope += rest[:, 1:].T
    limit = imprint * np.float32(1.0 / decay)
    return np.asarray((imprint > 0.0) & (slope[0] * slope[0] + slope[1] * slope[1] < limit * limit))
