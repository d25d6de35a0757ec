# SPDX-License-Identifier: Apache-2.0
"""The pose estimator of the paper (Suh et al., Sec. VII): patch centroids and the curl of the infrared flow.

Kept as the reference method, with its limits: x and z follow the centroid of the patch, which a long tool does not
move, and yaw lags behind. Frame from the two patches (Sec. VII-B), with the lost formulas derived again:

    y = unit(p_L - p_R),  x = unit((y_y, -y_x, 0)) (no z component: zero pitch),  z = x x y,  p = (p_L + p_R) / 2
    X_CP = ([x y z] Ry(theta), p),   X_CT = X_CP(t) X_CP(grasp)^-1

theta is the mean of dv/dx - du/dy over the patch times `curl_gain`; a rigid turn by phi about the optical axis has a
curl of 2 sin(phi), and the two axes point along -y_C and +y_C.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError
from seed_core.spatial import Array, inverse_pose, make_pose
from seed_estimation.contact.patch import ContactPatch, Mask
from seed_estimation.images.tactile_images import Image

# x, y, z, roll, pitch, yaw. Sec. VIII-B works with roll as well, but that of a long handle has the wrong sign
OBSERVED = (False, True, False, False, True, False)
# What the method misses by, as deviations: roll, pitch, yaw [rad], x, y, z [m]; measured on rendered bubbles
DEVIATION = (0.15, 0.08, 0.16, 2.0e-3, 6.0e-4, 3.0e-3)


@dataclass(frozen=True)
class FlowSettings:
    """Farneback's settings; the defaults are those of the public soft-bubble kit."""

    pyramid: float = 0.5
    levels: int = 30
    window: int = 50
    iterations: int = 5
    poly_n: int = 7
    poly_sigma: float = 1.5


def eight_bit(ir: Image) -> NDArray[np.uint8]:
    """Infrared (H, W) [counts] as 8 bits, from black to its 99th percentile."""
    top = float(np.percentile(ir[::4, ::4], 99.0))
    return np.asarray(cv2.convertScaleAbs(cv2.max(ir, 0.0), alpha=230.0 / max(top, 1.0)), np.uint8)


def dense_flow(before: NDArray[np.uint8], after: NDArray[np.uint8], settings: FlowSettings) -> Image:
    """Flow (H, W, 2) [px] from one 8-bit image to another."""
    s = settings
    return np.asarray(
        cv2.calcOpticalFlowFarneback(
            before,
            after,
            None,
            s.pyramid,
            s.levels,
            s.window,
            s.iterations,
            s.poly_n,
            s.poly_sigma,
            0,
        )
    )


def mean_curl(flow: Image, mask: Mask) -> float:
    """Mean of dv/dx - du/dy over the mask, by Sobel's operator; 0 for an empty mask."""
    dv_dx = cv2.Sobel(flow[..., 1], cv2.CV_32F, 1, 0, ksize=3, scale=1.0 / 8.0)
    du_dy = cv2.Sobel(flow[..., 0], cv2.CV_32F, 0, 1, ksize=3, scale=1.0 / 8.0)
    return float(cv2.mean(dv_dx - du_dy, mask)[0])


def fitted_gain(curls: Sequence[float], pitches: Sequence[float]) -> float:
    """The method's one constant, from mean curls at known pitches [rad] (the sign of the finger's axis taken out).

    A rigid turn seen sharply has 1/2; the patch's skirt, which does not turn, and the flow's window make it more.

    Raises:
        SeedError: the pitches do not move the curl.
    """
    c, p = np.asarray(curls, float), np.asarray(pitches, float)
    if not float(c @ c) > 1e-6 or not np.isfinite(p).all():
        raise SeedError(
            f"{c.size} curls of {np.abs(c).max(initial=0.0):.4f} at most tell no gain: turn the tool by 2 to 8 degrees"
        )
    return float(c @ p / (c @ c))


def patch_frame(p_L: Array, p_R: Array, pitch: float) -> Array | None:
    """X_CP (4, 4) from the centroids in C (3,) [m] and pitch [rad]; None when they coincide or stand along z."""
    y = p_L - p_R
    length, across = float(np.linalg.norm(y)), float(np.hypot(y[0], y[1]))
    if not across > 1e-3 * max(length, 1e-6):
        return None
    x = np.array((y[1], -y[0], 0.0)) / across
    y = y / length
    c, s = cos(pitch), sin(pitch)
    R = np.column_stack((x, y, np.cross(x, y))) @ np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))
    return make_pose(R, 0.5 * (p_L + p_R))


class PublishedMethod:
    """Sec. VII, from the moment of grasp on."""

    def __init__(
        self,
        patches: Mapping[str, ContactPatch],
        ir: Mapping[str, Image],
        X_CX: Mapping[str, Array],
        gain: float,
        settings: FlowSettings,
    ) -> None:
        """patches, ir and X_CX (poses of the optical frames in C) of 'left' and 'right' at the moment of grasp."""
        self.gain, self.settings = gain, settings
        self.before = {finger: eight_bit(image) for finger, image in ir.items()}
        self.sign = {finger: float(np.sign(X[1, 2])) for finger, X in X_CX.items()}  # optical axis along +-y_C
        X_CP = patch_frame(patches["left"].centroid_C, patches["right"].centroid_C, 0.0)
        self.X_PC_grasp = None if X_CP is None else inverse_pose(X_CP)

    def pitch(self, ir: Mapping[str, Image], masks: Mapping[str, Mask]) -> float:
        """Rotation about y since the grasp [rad]: mean over both fingers."""
        angles = [
            self.sign[f] * self.gain * mean_curl(dense_flow(self.before[f], eight_bit(ir[f]), self.settings), masks[f])
            for f in self.before
        ]
        return float(np.mean(angles))

    def pose(
        self, patches: Mapping[str, ContactPatch], ir: Mapping[str, Image], masks: Mapping[str, Mask]
    ) -> Array | None:
        """X_CT (4, 4), or None where the two patches define no frame."""
        X_CP = patch_frame(patches["left"].centroid_C, patches["right"].centroid_C, self.pitch(ir, masks))
        if X_CP is None or self.X_PC_grasp is None:
            return None
        return np.asarray(X_CP @ self.X_PC_grasp)
