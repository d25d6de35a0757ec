# SPDX-License-Identifier: Apache-2.0
"""Where a membrane touches the tool, told from its shape: where it hangs free, Laplace's law bends it as at rest.

A free membrane bears the bubble's pressure by its tension: pressure = tension x (sum of its two curvatures). A tool
takes over what is missing, so where the membrane is bent less than at rest, or the other way, it is pressed by

    contact pressure / bubble's pressure = 1 - curvature / curvature at rest
"""

import cv2
import numpy as np

from seed_estimation.contact.membrane import Membrane
from seed_estimation.contact.surface import surface
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Array32, Bools, Image, Mask

BLUR = 4.0  # [px] of depth before its curvature is taken
PRESSED = 0.4  # [1] of the bubble's pressure from which on a pixel counts as touching: blurred edges are half as steep
OPENING = 5  # [px] smaller pieces are noise


def touching(membrane: Membrane, depth: Image, mask: Mask) -> Bools:
    """(H, W) where the membrane of depth (H, W) [m], averaged over some frames, touches, within the contact's mask."""
    valid = np.isfinite(depth) & (membrane.area > 0)
    rest = curvature(membrane.camera, membrane.depth, np.isfinite(membrane.depth))
    inside = mask > 0
    usual = float(np.nanmedian(rest[inside]))
    with np.errstate(invalid="ignore"):
        pressed = inside & (curvature(membrane.camera, depth, valid) / usual < 1.0 - PRESSED)
    ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (OPENING, OPENING))
    closed = cv2.morphologyEx(pressed.astype(np.uint8), cv2.MORPH_CLOSE, ellipse)
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, ellipse)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    if count < 2:
        return np.zeros(depth.shape, bool)
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def curvature(camera: PinholeCamera, depth: Image, valid: Bools) -> Array32:
    """(H, W) sum of the two curvatures [1/m] of a surface seen at depth (H, W) [m], by its fundamental forms."""
    P, n = surface(camera, depth, valid, BLUR)
    P_u, P_v, n_u, n_v = (cv2.Sobel(a, cv2.CV_32F, i, 1 - i) for a in (P, n) for i in (1, 0))
    E, F, G = ((a * b).sum(axis=2) for a, b in ((P_u, P_u), (P_u, P_v), (P_v, P_v)))
    e, f, g = ((a * b).sum(axis=2) for a, b in ((n_u, P_u), (n_u, P_v), (n_v, P_v)))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((e * G - 2.0 * f * F + g * E) / (E * G - F * F), np.float32)
