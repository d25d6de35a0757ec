# SPDX-License-Identifier: Apache-2.0
"""What the camera behind a gel sees: free, with a ball, with a handle, and the handle turned and read."""

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import pose_from_rpy
from seed_sim.gel import GelParameters, GelRenderer, gel_hand
from seed_sim.gel.estimator import BALL, calibrate_gels, gel_estimator

_GAP, _TITLE = 12, 34  # [px]


def gel_images() -> bytes:
    """PNG of four images."""
    p = GelParameters()
    gels = GelRenderer(p, gel_hand(p), 4)
    finger, moved = gels.fingers["left"], pose_from_rpy(np.deg2rad((1.0, 8.0, 1.0)), np.array((5e-4, 0.0, -5e-4)))
    estimator = gel_estimator(gels, calibrate_gels(gels))
    held = gels.render(np.eye(4), 0.0)
    estimator.initialize_grasp([held])
    estimator.update(gels.render(moved, 0.1), 0.1)
    read = estimator.debug_image()[:, : finger.camera.width]
    ball = finger.image(finger.ball(BALL, 0.002, 0.001, 9e-4), 0.0)
    panels = (
        ("touching nothing", gels.no_contact(0.0)["left"].rgb[..., ::-1]),
        ("a ball, for the calibration", ball.rgb[..., ::-1]),
        ("a handle 9 mm wide", held["left"].rgb[..., ::-1]),
        ("turned by 8 degrees, and read", read),
    )
    drawn = [_titled(title, np.ascontiguousarray(panel)) for title, panel in panels]
    page = np.vstack([np.hstack(drawn[:2]), np.hstack(drawn[2:])])
    return bytes(cv2.imencode(".png", page)[1])


def _titled(title: str, panel: NDArray[np.uint8]) -> NDArray[np.uint8]:
    out = np.full((len(panel) + _TITLE + _GAP, panel.shape[1] + 2 * _GAP, 3), 255, np.uint8)
    out[_TITLE:-_GAP, _GAP:-_GAP] = panel
    cv2.putText(out, title, (_GAP, _TITLE - 11), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (50, 50, 50), 1, cv2.LINE_AA)
    return out
