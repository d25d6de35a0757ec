# SPDX-License-Identifier: Apache-2.0
"""The estimator on bubbles that no line of the simulator has drawn: right, and honest about cameras that are astray."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from seed_core.hand import Hand
from seed_core.spatial import pose_from_rpy
from seed_sim import Scenario
from seed_sim.tactile.trajectory import TrajectorySection
from seed_testing.validation.other_renderer.renderer import OtherRenderer
from seed_testing.validation.other_renderer.run import run_other
from seed_testing.validation.other_renderer.sheet import Held
from seed_testing.validation.scores import scores

SHORT = replace(Scenario(), trajectory=TrajectorySection(duration=3.0))


def test_it_sees_the_tool_where_it_is() -> None:
    bubbles = OtherRenderer(Held(0.012), Hand(), 3)
    bubbles.render(np.eye(4), 0.0)
    left = bubbles.render(pose_from_rpy((0.0, 0.0, 0.0), (0.0, 0.001, 0.0)), 0.1)["left"].depth[70:104, 114:119]
    assert_allclose(np.nanmedian(left), 0.105 - 0.013, atol=3e-4)  # to the camera, less the radius and 1 mm


def test_the_pose_is_right_and_honest_with_cameras_that_are_astray() -> None:
    result = scores(run_other(SHORT, "rigid_fit", 11, astray=1.0))
    assert result["valid_fraction"] > 0.99
    assert result["nees"] < 9.0
    assert max(result["rmse"].values()) < 0.6
