# SPDX-License-Identifier: Apache-2.0
"""The weight of the tool, which the paper left out: without it the force error is exactly m g."""

from __future__ import annotations

import numpy as np

from seed_core.spatial import Array, Wrench, cross

GRAVITY = 9.81  # [m/s^2]


def weight_about_T(mass: float, center_of_mass: Array, R_WT: Array) -> Wrench:
    """Load of gravity on the tool about T's origin, written in T.

    Args:
        mass: [kg].
        center_of_mass: (3,) [m] in T.
        R_WT: (3, 3) orientation of the tool; W's z axis points up.
    """
    force = R_WT[2] * (-mass * GRAVITY)  # R_TW (0, 0, -m g): the last row of R_WT
    return Wrench(cross(center_of_mass, force), np.asarray(force))
