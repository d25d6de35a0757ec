# SPDX-License-Identifier: Apache-2.0
"""The flange command: the arm's lag is learnt."""

import numpy as np
from numpy.testing import assert_allclose

from seed_control.command.flange_command import LagEstimate


def test_lag_is_learnt_from_motion_and_kept_at_rest() -> None:
    lag = LagEstimate(0.015)
    for _ in range(3000):
        lag.update(np.array((0.05 * 0.08, 0.0, 0.0)), np.zeros(3), (0.05, 0.0, 0.0), 0.004)
    assert_allclose(lag.lag, 0.08, atol=2e-3)
    for _ in range(1000):
        lag.update(np.array((0.01, 0.0, 0.0)), np.zeros(3), (0.0, 0.0, 0.0), 0.004)
    assert_allclose(lag.lag, 0.08, atol=2e-3)
