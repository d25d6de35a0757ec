# SPDX-License-Identifier: Apache-2.0
"""One run of an estimator on the other renderer, with cameras that are as believed or astray."""

from dataclasses import replace

import cv2
import numpy as np
from tqdm import tqdm

from seed_core.hand import FINGERS, Hand
from seed_core.spatial import Array, pose_from_rpy
from seed_estimation import Estimator
from seed_estimation.calibration.file import frame_of
from seed_sim.closed_loop.relative_poses import estimator_parameters, refuse_calibrate
from seed_sim.scenario import Scenario
from seed_sim.tactile.trajectory import poses
from seed_testing.validation.other_renderer.renderer import Camera, OtherRenderer
from seed_testing.validation.other_renderer.sheet import Held
from seed_testing.validation.scores import Series

MOUNT_DEG, MOUNT_MM, FOCAL, SCALE, OFFSET = 0.5, 0.5, 0.01, 0.01, 0.00035  # largest errors, drawn uniformly
REFERENCE_FRAMES, GRASP_FRAMES, LEAD = 20, 8, 2.0  # [1], [1], [s]


def run_other(scenario: Scenario, method: str, seed: int, astray: float) -> Series:
    """Truth and estimates of the scenario's trajectory and tool, without its membranes and noise.

    Args:
        scenario: what is held, how it moves, and the estimator's parameters.
        method: of the estimator.
        seed: of motion, dots, noise and errors.
        astray: share of the largest errors of mounts, focal lengths and depths.

    Raises:
        SeedError: the estimator does not see the grasp, or the scenario wants a calibration.
    """
    refuse_calibrate(scenario, "the other renderer")
    cv2.setNumThreads(1)
    tool, rng = scenario.tactile.tool, np.random.default_rng((seed, 78))

    def off(size: float, count: int) -> Array:
        return astray * size * rng.uniform(-1.0, 1.0, count)

    def mount(X_CX: Array) -> Array:
        return X_CX @ pose_from_rpy(np.deg2rad(off(MOUNT_DEG, 3)), 1e-3 * off(MOUNT_MM, 3))

    believed = scenario.hand
    hand: Hand = replace(believed, C_L=frame_of(mount(believed.X_CL)), C_R=frame_of(mount(believed.X_CR)))
    wrong = {f: Camera(*(float(off(size, 1)[0]) for size in (FOCAL, SCALE, OFFSET))) for f in FINGERS}
    held = Held(tool.radius, tool.length, None if tool.round else tool.width)
    bubbles = OtherRenderer(held, hand, seed, wrong)
    estimator = Estimator(estimator_parameters(scenario, method), believed, bubbles.cameras)
    step = 1.0 / scenario.trajectory.rate
    estimator.capture_reference([bubbles.no_contact(-LEAD + step * i) for i in range(REFERENCE_FRAMES)])
    estimator.initialize_grasp([bubbles.render(np.eye(4), step * (i - GRASP_FRAMES)) for i in range(GRASP_FRAMES)])
    series = Series()
    for stamp, X_CT in tqdm(list(poses(scenario.trajectory, seed)), desc=method, unit="pair", disable=None):
        series.estimate(estimator, bubbles.render(X_CT, stamp), stamp, X_CT)
    return series
