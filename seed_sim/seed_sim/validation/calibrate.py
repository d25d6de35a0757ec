# SPDX-License-Identifier: Apache-2.0
"""Calibrates an estimator's range from rendered captures, as one does with a real bubble before the first grasp."""

from __future__ import annotations

import warnings

import numpy as np

from seed_estimation.estimator import Estimator
from seed_sim.tactile import TactileRenderer
from seed_sim.tactile.captures import membrane_depth

FRAMES = 150
_START = -60.0  # [s]; before everything else of a run
_RATE = 45.0  # [Hz]


def calibrate(estimator: Estimator, renderer: TactileRenderer) -> None:
    """Gives the estimator the offset of each pixel's range: known shape of the free membrane minus its mean image."""
    frames = [renderer.no_contact(_START + i / _RATE) for i in range(FRAMES)]
    offsets = {}
    for finger in renderer.cameras:
        stack = np.stack([f[finger].depth for f in frames])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # corners never have depth
            measured = np.nanmean(stack, axis=0)
        offsets[finger] = np.asarray(membrane_depth(renderer, finger) - measured, np.float32)
    estimator.use_calibration(offsets)
