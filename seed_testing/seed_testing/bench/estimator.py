# SPDX-License-Identifier: Apache-2.0
"""Cost of an estimate: the rigid fit beside the published method with the public kit's Farneback settings.

CPU time of this process on one core, over the same pairs of frames: flat patches with random dots that turn and shift.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from math import sin

import cv2
import numpy as np

from seed_core.hand import Hand
from seed_estimation import Estimator, EstimatorParameters, PinholeCamera, TactileImages
from seed_testing.figures import figures
from seed_testing.recordings.infrared import Motion, WarpedImage

Pair = Mapping[str, TactileImages]
PITCH = 7.0  # [px] measured spacing of dots
PERIOD = 1.0 / 45.0  # [s]


def dots(seed: int, shape: tuple[int, int] = (171, 224)) -> np.ndarray:
    """(H, W) float32 [counts] of random dots at the measured spacing."""
    rng = np.random.default_rng(seed)
    image = np.ones(shape)
    v, u = np.mgrid[: shape[0], : shape[1]]
    for y in np.arange(3.0, shape[0], PITCH):
        for x in np.arange(3.0, shape[1], PITCH):
            centre = np.array((y, x)) + rng.normal(0.0, 1.2, 2)
            image *= 1.0 - rng.uniform(0.36, 0.67) * np.exp(-((v - centre[0]) ** 2 + (u - centre[1]) ** 2) / 3.4)
    return (900.0 * image).astype(np.float32)


class TurningPatches:
    """Two bubbles whose patches turn about the cameras' axes and shift."""

    def __init__(self) -> None:
        K = np.array(((214.06, 0.0, 116.25), (0.0, 214.06, 87.57), (0.0, 0.0, 1.0)))
        self._fingers = {name: WarpedImage(dots(i), K, radius=28.0, seed=i) for i, name in enumerate(("left", "right"))}
        self.cameras = {name: one.camera for name, one in self._fingers.items()}

    def pair(self, turn: float, stamp: float, contact: bool = True) -> Pair:
        """Images with the patches turned [deg] at time stamp [s]."""
        sides = {"left": Motion(-turn, -turn / 4, 0.0), "right": Motion(turn, -turn / 4, 0.0)}
        return {name: one.render(sides[name], stamp, contact) for name, one in self._fingers.items()}


class Timed:
    """One method, ready to go, and the CPU time of each pair of frames that it was given [ms]."""

    def __init__(
        self, method: str, cameras: Mapping[str, PinholeCamera], reference: Sequence[Pair], grasp: Sequence[Pair]
    ) -> None:
        self._estimator = Estimator(EstimatorParameters(method=method), Hand(), cameras)
        self._estimator.capture_reference(reference)
        self._estimator.initialize_grasp(grasp)
        self.spent: list[float] = []
        self._valid = 0

    def update(self, images: Pair, stamp: float) -> None:
        """Times one pair."""
        start = time.process_time()
        self._valid += self._estimator.update(images, stamp).valid
        self.spent.append(1e3 * (time.process_time() - start))

    def result(self) -> dict[str, float]:
        """CPU milliseconds per pair, and the share of valid estimates."""
        return {**figures("{}_ms", self.spent, "median", "p99"), "valid_fraction": self._valid / len(self.spent)}


def run(frames: int = 240) -> dict[str, object]:
    """Both methods over the same frames, side by side: every eighth goes to the published one as well."""
    cv2.setNumThreads(1)
    patches = TurningPatches()
    reference = [patches.pair(0.0, -2.0 + 0.02 * i, contact=False) for i in range(5)]
    grasp = [patches.pair(0.0, -0.1 + 0.02 * i) for i in range(5)]
    moving = [patches.pair(12.0 * sin(0.06 * i), i * PERIOD) for i in range(1, frames + 1)]
    fit, published = (Timed(method, patches.cameras, reference, grasp) for method in ("rigid_fit", "published"))
    for i, images in enumerate(moving, start=1):
        fit.update(images, i * PERIOD)
        if i % 8 == 0:
            published.update(images, i * PERIOD)
    ratio = float(np.median(published.spent) / np.median(fit.spent))
    return {"rigid_fit": fit.result(), "published": published.result(), "times_faster": ratio}
