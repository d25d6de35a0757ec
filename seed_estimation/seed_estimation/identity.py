# SPDX-License-Identifier: Apache-2.0
"""Whose images are these? Each bubble's printed dots are its fingerprint.

Motion alone cannot tell a bubble mounted upside down, or left from right. The dots of the no-contact reference,
normalised, are saved; an image is compared with its own, with its own turned by half a turn, and with the other's.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from seed_estimation.images import Image
from seed_estimation.normalise import normalised

BLUR = 2.0  # [px] pressing moves the dots by some pixels; the pattern as a whole stays
SAME = 0.35  # correlation above which two patterns are one
MARGIN = 0.15  # by which another must fit better than the own


def pattern(ir: Image) -> Image:
    """The dots of an infrared image (H, W), normalised and blurred."""
    return np.asarray(cv2.GaussianBlur(normalised(ir), (0, 0), BLUR), np.float32)


def correlation(a: Image, b: Image) -> float:
    """Of two patterns of one size, -1 to 1; the best quarter of the tiles counts, for contact moves the rest."""
    if a.shape != b.shape:
        return 0.0
    side = max(8, min(a.shape) // 6)
    scores = []
    for v in range(0, a.shape[0] - side + 1, side):
        for u in range(0, a.shape[1] - side + 1, side):
            x, y = a[v : v + side, u : u + side], b[v : v + side, u : u + side]
            scores.append(float(np.sum(x * y)) / (float(np.sqrt(np.sum(x * x) * np.sum(y * y))) + 1e-6))
    scores.sort()
    return float(np.mean(scores[-max(1, len(scores) // 4) :]))


def mistaken(finger: str, ir: Image, known: Mapping[str, Image]) -> str:
    """Why an image is not the finger's own upright one, or '' when nothing says so; known: saved patterns by finger."""
    if finger not in known:
        return ""
    seen = pattern(ir)
    own = correlation(seen, known[finger])
    if own >= SAME + MARGIN:
        return ""
    turned = correlation(np.ascontiguousarray(seen[::-1, ::-1]), known[finger])
    if turned > max(SAME, own + MARGIN):
        return (
            f"{finger} image is rotated by 180 degrees against the saved dot pattern: check how the camera is mounted"
        )
    for other, image in known.items():
        if other != finger and correlation(seen, image) > max(SAME, own + MARGIN):
            return f"{finger} image shows the {other} bubble's dots: left and right are swapped"
    return ""
