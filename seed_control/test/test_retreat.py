# SPDX-License-Identifier: Apache-2.0
"""A force is taken back faster than it is built up, and a hold gives way by the gripper's place of each image."""

import numpy as np
import pytest

from seed_control.command.relief import Relief
from seed_control.law.tip_reference import HeightReference, TipReference
from seed_core.vector3 import ZERO

PRESS = np.array((0.0, 0.0, -10.0))  # N, of the tool on the environment


@pytest.mark.parametrize(("height", "step"), [(0.1, 0.25), (-0.1, -0.045)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_retreat_has_the_grippers_speed_a_press_its_own(height: float, step: float, sign: int) -> None:
    reference = TipReference()
    reference.lead(np.eye(4), np.zeros(3))
    n = (0.0, 0.0, float(sign))
    reference.follow([HeightReference(n, sign * height, ZERO, 0.045, back=0.25, pushes=-sign)], ZERO, ZERO)
    x, y, z = reference.target(0.004, 0.0, 0.06)
    assert (x, y) == (0.0, 0.0)
    assert z == pytest.approx(0.004 * step)


def test_relief_counts_from_where_the_gripper_was_at_the_image() -> None:
    relief, held_at = Relief(2.0, 0.03), (0.0, 0.0, 0.5)
    for _ in range(3):
        relief.image(np.array((0.0, 0.0, -14.0)), PRESS, 1000.0, 0.1, np.array(held_at), held_at)
    assert relief.way == pytest.approx(4e-3)
    # late images of the same press ask for no more than the same way
    relief.image(np.array((0.0, 0.0, -13.0)), PRESS, 1000.0, 0.1, np.array((0.0, 0.0, 0.501)), held_at)
    assert relief.way == pytest.approx(4e-3)
    # a surface that goes on rising asks for more at once
    relief.image(np.array((0.0, 0.0, -14.0)), PRESS, 1000.0, 0.1, np.array((0.0, 0.0, 0.504)), held_at)
    assert relief.way == pytest.approx(8e-3)
    assert relief.target(held_at) == pytest.approx((0.0, 0.0, 0.508))
