# SPDX-License-Identifier: Apache-2.0
"""The pose estimator of the paper (Sec. VII): patch frame from two contact patches, pitch from the curl of the flow.

Kept as the reference method, with its limits: x and z follow the centroid of the patch, which a long tool does not
move, and yaw lags behind. The paper's formulas, as derived again:

    patch frame (Sec. VII-B)   y = unit(p_L - p_R),  x = unit((y_y, -y_x, 0)) (no z component: zero pitch),
                               z = x x y,  p = (p_L + p_R) / 2,  X_CP = ([x y z] Ry(theta), p)
    pitch (Sec. VII-C)         theta = curl_gain * mean of dv/dx - du/dy over the patch
    tool                       X_CT = X_CP(t) X_CP(grasp)^-1

A rigid turn by phi about the optical axis has a curl of 2 sin(phi), and the two axes point along -y_C and +y_C.
"""

from collections.abc import Mapping, Sequence
from math import cos, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError
from seed_core.spatial import Array, inverse_pose, make_pose
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.images.tactile_images import Image, Mask, TactileImages
from seed_estimation.parameters import EstimatorParameters

# Farneback's settings in the public soft-bubble kit; its window is the parameter `flow_window`
PYRAMID, LEVELS, ITERATIONS, POLY_N, POLY_SIGMA = 0.5, 30, 5, 7, 1.5


class PublishedMethod:
    """Sec. VII, from the moment of grasp on.

    Attributes:
        parameters: in force. `curl_gain`, pitch over mean curl, is the paper's normalisation constant; `flow_window` is
            Farneback's.
        observed: x, y, z, roll, pitch, yaw. Sec. VIII-B works with roll as well, but that of a long handle has the
            wrong sign.
        deviation: by which the method errs: roll, pitch, yaw [rad], x, y, z [m]; measured on rendered bubbles.
    """

    observed = (False, True, False, False, True, False)
    deviation = (0.15, 0.08, 0.16, 2.0e-3, 6.0e-4, 3.0e-3)

    def __init__(
        self,
        patches: Mapping[str, ContactPatch],
        ir: Mapping[str, Image],
        X_CX: Mapping[str, Array],
        parameters: EstimatorParameters,
    ) -> None:
        """patches, ir (H, W) [counts] and X_CX (poses of the optical frames in C) of both fingers at the grasp."""
        self.parameters = parameters
        self._before = {finger: eight_bit(image) for finger, image in ir.items()}
        self._sign = {finger: float(np.sign(X_CX[finger][1, 2])) for finger in ir}  # optical axis along +-y_C
        X_CP = patch_frame(patches["left"].centroid_C, patches["right"].centroid_C, 0.0)
        self._X_PC_grasp = None if X_CP is None else inverse_pose(X_CP)

    def pose(
        self, patches: Mapping[str, ContactPatch], images: Mapping[str, TactileImages], masks: Mapping[str, Mask]
    ) -> tuple[Array | None, str]:
        """X_CT (4, 4) from both fingers' patches, images and contact masks; or None, and the reason."""
        silent = [f for f, patch in patches.items() if not patch.in_contact]
        if silent:
            return None, f"{' and '.join(silent)} bubble touches nothing"
        gain, window = self.parameters.curl_gain, self.parameters.flow_window
        pitches = [
            pitch_from_curl(before, eight_bit(images[f].ir), masks[f], self._sign[f] * gain, window)
            for f, before in self._before.items()
        ]
        X_CP = patch_frame(patches["left"].centroid_C, patches["right"].centroid_C, float(np.mean(pitches)))
        if X_CP is None or self._X_PC_grasp is None:
            return None, "the two patches define no frame: they stand above each other along z"
        return np.asarray(X_CP @ self._X_PC_grasp), ""


def patch_frame(p_L: Array, p_R: Array, pitch: float) -> Array | None:
    """Pose X_CP (4, 4) of the patch frame (Sec. VII-B) from the centroids in C (3,) [m] and the pitch [rad].

    None when the centroids coincide or stand along z.
    """
    y = p_L - p_R  # Sec. VII-B, step 1: the axis between the patches, normalised below
    length, across = float(np.linalg.norm(y)), float(np.hypot(y[0], y[1]))
    if not across > 1e-3 * max(length, 1e-6):
        return None
    x = np.array((y[1], -y[0], 0.0)) / across  # steps 2 and 3: across y, without z component, which is zero pitch
    y = y / length
    z = np.cross(x, y)  # step 4
    c, s = cos(pitch), sin(pitch)
    R = np.column_stack((x, y, z)) @ np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))  # pitch about y, Sec. VII-C
    return make_pose(R, 0.5 * (p_L + p_R))  # the frame's origin: the average of the two patches


def pitch_from_curl(before: NDArray[np.uint8], now: NDArray[np.uint8], mask: Mask, gain: float, window: int) -> float:
    """Pitch [rad] of one finger's patch (Sec. VII-C): theta = gain * mean curl of the optical flow since the grasp.

    Args:
        before, now: 8-bit infrared (H, W) at the grasp and now.
        mask: (H, W) contact patch now.
        gain: pitch over mean curl, with the sign of the finger's optical axis along y_C.
        window: of Farneback's method [px].
    """
    return gain * mean_curl(dense_flow(before, now, window), mask)


def mean_curl(flow: Image, mask: Mask) -> float:
    """Curl dv/dx - du/dy of a flow (H, W, 2), mean over the mask, by Sobel's operator (Sec. VII-C); 0 if empty."""
    dv_dx = cv2.Sobel(flow[..., 1], cv2.CV_32F, 1, 0, ksize=3, scale=1.0 / 8.0)
    du_dy = cv2.Sobel(flow[..., 0], cv2.CV_32F, 0, 1, ksize=3, scale=1.0 / 8.0)
    return float(cv2.mean(dv_dx - du_dy, mask)[0])


def dense_flow(before: NDArray[np.uint8], after: NDArray[np.uint8], window: int) -> Image:
    """Flow (H, W, 2) [px] from one 8-bit image to another (Sec. VII-C), by Farneback's method."""
    flow = cv2.calcOpticalFlowFarneback(before, after, None, PYRAMID, LEVELS, window, ITERATIONS, POLY_N, POLY_SIGMA, 0)
    return np.asarray(flow, np.float32)


def eight_bit(ir: Image) -> NDArray[np.uint8]:
    """Infrared (H, W) [counts] as 8 bits, from black to its 99th percentile."""
    top = float(np.percentile(ir[::4, ::4], 99.0))
    return np.asarray(cv2.convertScaleAbs(cv2.max(ir, 0.0), alpha=230.0 / max(top, 1.0)), np.uint8)


def fitted_gain(curls: Sequence[float], pitches: Sequence[float]) -> float:
    """The method's one constant, from known pitches.

    A rigid turn seen sharply has 1/2; the rim of the patch, where the membrane does not turn with the tool, and the
    flow's window make it more.

    Args:
        curls: mean curls, the sign of the finger's axis taken out.
        pitches: known ones [rad].

    Raises:
        SeedError: the pitches do not move the curl.
    """
    c, p = np.asarray(curls, float), np.asarray(pitches, float)
    if not float(c @ c) > 1e-6 or not np.isfinite(p).all():
        raise SeedError(
            f"{c.size} curls of {np.abs(c).max(initial=0.0):.4f} at most tell no gain: turn the tool by 2 to 8 degrees"
        )
    return float(c @ p / (c @ c))
