# SPDX-License-Identifier: Apache-2.0
"""One run of an estimator: reference, grasp and motion, all rendered, with the truth beside every estimate."""

from dataclasses import replace

import cv2
import numpy as np
from tqdm import tqdm

from seed_core.config import from_mapping
from seed_core.errors import SeedError
from seed_estimation import Estimator, EstimatorParameters
from seed_sim import TactileRenderer
from seed_sim.bubble_renderer import HeldRenderer, renderer_of
from seed_sim.scenario import SHIPPED, Scenario, on_membrane
from seed_sim.tactile.trajectory import poses
from seed_testing.validation.calibrate import calibration
from seed_testing.validation.scores import Series

VALIDATE = ("seed_testing", "config/validate")
FOLDERS = (VALIDATE, SHIPPED)  # of the scenarios that `./seed validate` knows by name
REFERENCE_FRAMES, GRASP_FRAMES = 20, 8
# The renderer's cameras are those that the estimator is told of, and these errors are none: docs/estimation_inside.md
EXACT = dict.fromkeys(
    (
        "mount_rotation_std", "mount_position_std", "focal_std", "depth_scale_std", "depth_offset_std",
        "finger_skew_std", "depth_lag_std",
    ),
    0.0,
)  # fmt: skip
SCALE = 0.25  # of a scenario's motion that random membranes bear
_LEAD = 2.0  # [s] between the no-contact frames and the motion


def between_membranes(scenario: Scenario, seed: int, larger: float = 1.0) -> Scenario:
    """The tool between two random membranes with mechanics, moved so little that it stays in the grasp.

    larger: times that; it slides the more.
    """
    moved = replace(scenario.trajectory, scale=larger * SCALE * scenario.trajectory.scale)
    return replace(on_membrane(scenario, seed), trajectory=moved)


def run(scenario: Scenario, method: str, seed: int) -> Series:
    """Truth and estimates of one trajectory; the same on every run of a seed but for the times.

    Raises:
        SeedError: the scenario's parameters of the estimator cannot be used, it does not see the grasp, or the
            membranes do not bear the trajectory.
    """
    cv2.setNumThreads(1)
    series = Series()
    renderer = renderer_of(scenario, seed)
    estimator = estimator_for(scenario, method, renderer)
    for stamp, X_CT in tqdm(list(poses(scenario.trajectory, seed)), desc=method, unit="pair", disable=None):
        series.estimate(estimator, renderer.render(X_CT, stamp), stamp, X_CT)
        if isinstance(renderer, HeldRenderer):
            series.sliding.append(renderer.hold.state.sliding_share)
    return series


def estimator_for(scenario: Scenario, method: str, renderer: TactileRenderer | HeldRenderer) -> Estimator:
    """An estimator as the scenario configures it, with reference and grasp taken. Raises SeedError."""
    given = {**EXACT, **scenario.estimator, "method": method}
    parameters = from_mapping(given, EstimatorParameters, f"scenario {scenario.name}: estimator")
    calibrated = None
    if scenario.calibrate:
        if isinstance(renderer, HeldRenderer):
            raise SeedError("calibrate: the captures of a calibration are rendered on grasp.kind: bushing only")
        calibrated = calibration(renderer, scenario.hand)
    estimator = Estimator(parameters, scenario.hand, renderer.cameras, calibrated)
    step = 1.0 / scenario.trajectory.rate
    still = [-_LEAD + step * i for i in range(REFERENCE_FRAMES)]
    estimator.capture_reference([renderer.no_contact(t) for t in still])
    held = [-step * (GRASP_FRAMES - i) for i in range(GRASP_FRAMES)]
    estimator.initialize_grasp([renderer.render(np.eye(4), t) for t in held])
    return estimator
