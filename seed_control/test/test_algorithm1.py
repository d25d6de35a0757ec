# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1, the one-dimensional case."""

import pytest
from numpy.testing import assert_allclose

from seed_control.algorithm1 import loop_gain, motor_position
from seed_core.errors import SeedError


def test_algorithm_one_settles_at_the_force_asked_for_at_any_delay() -> None:
    """A motor on a spring of 800 N/m against a wall of 3 kN/m, its load seen `delay` steps late."""
    k, wall, force = 800.0, 3000.0, 5.0
    for delay in (1, 5, 25):
        motors, loads = [0.0] * (delay + 1), [0.0] * (delay + 1)
        for _ in range(60 * delay):
            motors.append(motor_position(force, k, loads[-delay]))
            loads.append(motors[-1] * loop_gain(k, wall))
        assert_allclose(k * (motors[-1] - loads[-1]), force, atol=1e-9)


def test_algorithm_one_refuses_a_stiffness_of_nothing() -> None:
    with pytest.raises(SeedError, match=r"stiffness = 0.0 N/m must be > 0"):
        motor_position(1.0, 0.0, 0.0)
