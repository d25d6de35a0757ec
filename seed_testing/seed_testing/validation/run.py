# SPDX-License-Identifier: Apache-2.0
"""One run: reference, grasp, motion, all rendered, through an estimator."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from seed_core.config import from_mapping
from seed_estimation import Estimator, EstimatorParameters
from seed_sim.scenario import SHIPPED, Scenario, tactile_of
from seed_sim.tactile import TactileRenderer
from seed_sim.tactile.trajectory import poses
from seed_testing.validation.scores import Series

VALIDATE = ("seed_testing", "config/validate")
FOLDERS = (VALIDATE, SHIPPED)  # of the scenarios that `./seed validate` knows by name
REFERENCE_FRAMES, GRASP_FRAMES = 20, 8
_LEAD = 2.0  # [s] between the no-contact frames and the motion
Progress = Callable[[float], None]


def estimator_for(scenario: Scenario, method: str, renderer: TactileRenderer) -> Estimator:
    """An estimator as the scenario configures it, with reference and grasp taken. Raises SeedError."""
    given = {**scenario.estimator, "method": method}
    parameters = from_mapping(given, EstimatorParameters, f"scenario {scenario.name}: estimator")
    estimator = _estimator(parameters, scenario, renderer)
    step = 1.0 / scenario.trajectory.rate
    still = [-_LEAD + step * i for i in range(REFERENCE_FRAMES)]
    estimator.capture_reference([renderer.no_contact(t) for t in still])
    held = [-step * (GRASP_FRAMES - i) for i in range(GRASP_FRAMES)]
    estimator.initialize_grasp([renderer.render(np.eye(4), t) for t in held])
    return estimator


def _estimator(parameters: EstimatorParameters, scenario: Scenario, renderer: TactileRenderer) -> Estimator:
    if not scenario.calibrate:
        return Estimator(parameters, scenario.hand, renderer.cameras)
    from seed_testing.validation.calibrate import calibration

    return Estimator(parameters, scenario.hand, renderer.cameras, calibration(renderer, scenario.hand))


def run(scenario: Scenario, method: str, seed: int, progress: Progress | None = None) -> Series:
    """Truth and estimates of one trajectory; the same on every run of a seed but for the times."""
    cv2.setNumThreads(1)
    section, series = scenario.trajectory, Series()
    renderer = TactileRenderer(tactile_of(scenario), scenario.hand, seed)
    estimator = estimator_for(scenario, method, renderer)
    for stamp, X_CT in poses(section, seed):
        images = renderer.render(X_CT, stamp)
        before = time.process_time()
        estimate = estimator.update(images, stamp)
        series.add(X_CT, estimate, 1e3 * (time.process_time() - before))
        if progress is not None:
            progress(stamp / section.duration)
    return series
