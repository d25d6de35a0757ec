# SPDX-License-Identifier: Apache-2.0
"""Cost of a pose from gels: CPU time of this process on one core, over rendered images of 320 x 240 px."""

import time

import cv2
import numpy as np

from seed_sim.gel import GelParameters, GelRenderer, gel_hand
from seed_sim.gel.estimator import calibrate_gels, gel_estimator
from seed_sim.tactile.trajectory import TrajectorySection, poses
from seed_testing.figures import figures

_MOTION = TrajectorySection(duration=3.0, rate=40.0, translation_mm=(0.4, 0.08, 0.4), rotation_deg=(1.2, 3.0, 1.2))


def run() -> dict[str, object]:
    """Two gels, and one alone, over the same motion; rendering is not counted."""
    cv2.setNumThreads(1)
    out: dict[str, object] = {}
    for name, fingers in (("both", "both"), ("one", "left")):
        p = GelParameters(fingers=fingers)
        renderer = GelRenderer(p, gel_hand(p), 1)
        estimator = gel_estimator(renderer, calibrate_gels(renderer, places=(6, 4)))
        estimator.initialize_grasp([renderer.render(np.eye(4), -0.05)])
        cost, valid = [], []
        for stamp, X_CT in poses(_MOTION, 0):
            images = renderer.render(X_CT, stamp)
            before = time.process_time()
            valid.append(estimator.update(images, stamp).valid)
            cost.append(1e3 * (time.process_time() - before))
        rate = 1e3 / float(np.median(cost))
        out[name] = {**figures("{}_ms", cost, "median", "p99"), "hz": rate, "valid_fraction": float(np.mean(valid))}
    return out
