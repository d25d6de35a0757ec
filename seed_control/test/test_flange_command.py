# SPDX-License-Identifier: Apache-2.0
"""The flange command: the arm's lag is learnt, and the flange stays in the workspace."""

import numpy as np
from numpy.testing import assert_allclose

from seed_control.command.flange_command import FlangeCommand, LagEstimate
from seed_control.parameters import ControllerParameters
from seed_core.hand import Hand
from seed_core.spatial import inverse_pose, make_pose, rotation_from_rpy


def test_lag_is_learnt_from_motion_and_kept_at_rest() -> None:
    lag = LagEstimate(0.015)
    for _ in range(3000):
        lag.update(np.array((0.05 * 0.08, 0.0, 0.0)), np.zeros(3), (0.05, 0.0, 0.0), 0.004)
    assert_allclose(lag.lag, 0.08, atol=2e-3)
    for _ in range(1000):
        lag.update(np.array((0.01, 0.0, 0.0)), np.zeros(3), (0.0, 0.0, 0.0), 0.004)
    assert_allclose(lag.lag, 0.08, atol=2e-3)


def test_the_flange_stays_in_the_workspace_while_the_gripper_turns() -> None:
    X_EC = Hand().X_EC
    command = FlangeCommand(ControllerParameters(workspace_high=(0.6, 1.3, 1.6)), X_EC)
    along_x = make_pose(rotation_from_rpy((0.0, -np.pi / 2, 0.0)), (0.4, 0.0, 0.5))  # the flange beyond C
    command.start_from(along_x @ inverse_pose(X_EC))
    command.turn_to(rotation_from_rpy((np.pi, 0.0, 0.0)))  # above it
    furthest = []
    for _ in range(2000):
        command.towards((0.59, 0.0, 0.5), 0.004, 0.25)
        furthest.append(command.X_WE[0, 3])
    assert max(furthest) < 0.601
    assert_allclose(command.p_WC, (0.59, 0.0, 0.5), atol=1e-3)
