# SPDX-License-Identifier: Apache-2.0
"""The guard of the motion: what is no number does not pass for a short way."""

import numpy as np
import pytest

from seed_control.command.guard import Guard
from seed_control.parameters import ControllerParameters
from seed_control.state import Counting

UP = np.array(((0.0, 0.0, 1.0),))


@pytest.mark.parametrize("z", [0.061, -0.061, np.nan, np.inf])
def test_an_approach_that_goes_too_far_or_nowhere_known_is_held(z: float) -> None:
    guard = Guard(ControllerParameters(), Counting(""))
    guard.enable(True)
    guard.check_free_travel((0.0, 0.0, 0.0), UP, True)
    guard.check_free_travel((0.0, 0.0, 0.059), UP, True)
    assert guard.following
    guard.check_free_travel((0.0, 0.0, z), UP, True)
    assert "no contact within max_free_travel" in guard.held
