# SPDX-License-Identifier: Apache-2.0
"""Cost of an estimate: the rigid fit beside the published method with the public kit's Farneback settings.

CPU time of this process on one core, over the same pairs of rendered images.
"""

import time
from collections.abc import Mapping

import cv2
import numpy as np

from seed_core.hand import Hand
from seed_estimation import Estimator, EstimatorParameters, TactileImages
from seed_sim import TactileParameters, TactileRenderer
from seed_sim.tactile.trajectory import TrajectorySection, poses
from seed_testing.figures import figures

_RATE = 45.0  # [Hz]


class Timed:
    """One method in a grasp, and the CPU time of each pair of images that it was given [ms]."""

    def __init__(self, method: str, renderer: TactileRenderer) -> None:
        self._estimator = Estimator(EstimatorParameters(method=method), renderer.hand, renderer.cameras)
        self._estimator.capture_reference([renderer.no_contact(-2.0 + i / _RATE) for i in range(5)])
        self._estimator.initialize_grasp([renderer.render(np.eye(4), (i - 5) / _RATE) for i in range(5)])
        self.spent: list[float] = []
        self._valid = 0

    def update(self, images: Mapping[str, TactileImages], stamp: float) -> None:
        """Times one pair."""
        start = time.process_time()
        self._valid += self._estimator.update(images, stamp).valid
        self.spent.append(1e3 * (time.process_time() - start))

    def result(self) -> dict[str, float]:
        """CPU milliseconds per pair, and the share of valid estimates."""
        return {**figures("{}_ms", self.spent, "median", "p99"), "valid_fraction": self._valid / len(self.spent)}


def run(frames: int = 240) -> dict[str, object]:
    """Both methods over the same images, side by side: every eighth pair goes to the published one as well."""
    cv2.setNumThreads(1)
    renderer = TactileRenderer(TactileParameters(), Hand(), 0)
    fit, published = Timed("rigid_fit", renderer), Timed("published", renderer)
    motion = poses(TrajectorySection(duration=frames / _RATE, rate=_RATE), 0)
    for i, (stamp, X_CT) in enumerate(motion, start=1):
        images = renderer.render(X_CT, stamp)
        fit.update(images, stamp)
        if i % 8 == 0:
            published.update(images, stamp)
    ratio = float(np.median(published.spent) / np.median(fit.spent))
    return {"rigid_fit": fit.result(), "published": published.result(), "times_faster": ratio}
