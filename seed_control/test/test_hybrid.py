# SPDX-License-Identifier: Apache-2.0
"""What the full law adds to Algorithm 2 for grasps that are stiff in translation and turn easily."""

import numpy as np
import pytest

from seed_control.law.hybrid import tipping_gain
from seed_core.bushing import Stiffness

PRESSED, LEVER = np.array((0.0, 0.0, -10.0)), np.array((0.0, 0.0, -0.12))
ABOUT_X = (True, False, False)


def test_the_axis_of_the_force_tips_nothing() -> None:
    """A yaw stiffness below F H = 1.2 N m/rad turns the tool about its own lever: the tip stays."""
    soft_yaw = Stiffness(rotation=(4.0, 3.0, 0.7), translation=(800.0, 1200.0, 800.0))
    assert tipping_gain(PRESSED, LEVER, ABOUT_X, soft_yaw) == pytest.approx(1.0 / (1.0 - 1.2 / 3.0))


def test_the_worst_held_axis_counts() -> None:
    k = Stiffness(rotation=(1.5, 3.0, 4.0), translation=(800.0, 1200.0, 800.0))
    assert tipping_gain(PRESSED, LEVER, (False, False, False), k) == pytest.approx(1.0 / (1.0 - 1.2 / 1.5))
    assert tipping_gain(PRESSED, LEVER, ABOUT_X, k) == pytest.approx(1.0 / (1.0 - 1.2 / 3.0))


def test_a_pull_tips_nothing() -> None:
    k = Stiffness(rotation=(1.0, 1.0, 1.0), translation=(800.0, 1200.0, 800.0))
    assert tipping_gain(-PRESSED, LEVER, ABOUT_X, k) == 1.0
