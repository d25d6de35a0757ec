# SPDX-License-Identifier: Apache-2.0
"""What an estimate costs: the rigid fit beside the published method with the public kit's Farneback settings.

CPU time of this process on one core, over the same pairs of frames; images are those of the caller, or flat
patches with random dots that turn and shift.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from math import sin

import cv2
import numpy as np

from seed_core.hand import Hand
from seed_estimation import Estimator, EstimatorParameters, PinholeCamera, TactileImages
from seed_testing.recordings.infrared import Motion, WarpedImage

Pair = Mapping[str, TactileImages]


def dots(seed: int, shape: tuple[int, int] = (171, 224)) -> np.ndarray:
    """(H, W) float32 [counts] of random dots at the measured spacing of 7 px."""
    rng = np.random.default_rng(seed)
    image = np.ones(shape)
    v, u = np.mgrid[: shape[0], : shape[1]]
    for y in np.arange(3.0, shape[0], 7.0):
        for x in np.arange(3.0, shape[1], 7.0):
            centre = np.array((y, x)) + rng.normal(0.0, 1.2, 2)
            image *= 1.0 - rng.uniform(0.36, 0.67) * np.exp(-((v - centre[0]) ** 2 + (u - centre[1]) ** 2) / 3.4)
    return (900.0 * image).astype(np.float32)


def turning_patches(frames: int) -> tuple[dict[str, PinholeCamera], list[Pair], list[Pair], list[Pair]]:
    """Cameras, no-contact frames, grasp frames and moving frames of two bubbles."""
    K = np.array(((214.06, 0.0, 116.25), (0.0, 214.06, 87.57), (0.0, 0.0, 1.0)))
    fingers = {name: WarpedImage(dots(i), K, radius=28.0, seed=i) for i, name in enumerate(("left", "right"))}

    def pair(turn: float, stamp: float, contact: bool = True) -> Pair:
        sides = {"left": Motion(-turn, -turn / 4, 0.0), "right": Motion(turn, -turn / 4, 0.0)}
        return {name: one.render(sides[name], stamp, contact) for name, one in fingers.items()}

    reference = [pair(0.0, -2.0 + 0.02 * i, contact=False) for i in range(5)]
    grasp = [pair(0.0, -0.1 + 0.02 * i) for i in range(5)]
    moving = [pair(12.0 * sin(0.06 * i), i / 45.0) for i in range(1, frames + 1)]
    return {name: one.camera for name, one in fingers.items()}, reference, grasp, moving


class Timed:
    """One method, ready to go, and the CPU time of each pair of frames that it was given [ms]."""

    def __init__(
        self, method: str, cameras: Mapping[str, PinholeCamera], reference: Sequence[Pair], grasp: Sequence[Pair]
    ) -> None:
        self._estimator = Estimator(EstimatorParameters(method=method), Hand(), cameras)
        self._estimator.capture_reference(reference)
        self._estimator.initialize_grasp(grasp)
        self.spent: list[float] = []
        self.valid = 0

    def update(self, images: Pair, stamp: float) -> None:
        """Times one pair."""
        start = time.process_time()
        self.valid += self._estimator.update(images, stamp).valid
        self.spent.append(1e3 * (time.process_time() - start))

    def result(self) -> dict[str, float]:
        """CPU milliseconds per pair: median and 99th percentile, and the share of valid estimates."""
        return {
            "median_ms": float(np.median(self.spent)),
            "p99_ms": float(np.percentile(self.spent, 99)),
            "valid_fraction": self.valid / len(self.spent),
        }


def run(frames: int = 240) -> dict[str, object]:
    """Both methods over the same frames, side by side: every eighth goes to the published one as well."""
    cv2.setNumThreads(1)
    cameras, reference, grasp, moving = turning_patches(frames)
    fit, old = (Timed(method, cameras, reference, grasp) for method in ("rigid_fit", "published"))
    for i, images in enumerate(moving):
        fit.update(images, (i + 1) / 45.0)
        if i % 8 == 7:
            old.update(images, (i + 1) / 45.0)
    ratio = float(np.median(old.spent) / np.median(fit.spent))
    return {"rigid_fit": fit.result(), "published": old.result(), "times_faster": ratio}
