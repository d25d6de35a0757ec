# SPDX-License-Identifier: Apache-2.0
"""The box that the flange must not leave, for targets that are given for the gripper's frame C."""

from __future__ import annotations

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_core.quaternion import Quaternion, to_pose
from seed_core.vector3 import Vector3, as_vector3


class Workspace:
    """Keeps targets inside; p_EC [m]: C in the flange."""

    def __init__(self, parameters: ControllerParameters, p_EC: Vector3) -> None:
        self._low, self._high = np.array(parameters.workspace_low), np.array(parameters.workspace_high)
        self._p_EC = p_EC
        margin = float(np.linalg.norm(p_EC))  # no rotation takes the flange further from C than this
        self._surely = (*as_vector3(self._low + margin), *as_vector3(self._high - margin))

    def within(self, p_WC: Vector3, q_WE: Quaternion) -> Vector3:
        """The target [m] itself (the same object) while the flange stays inside, else the nearest that keeps it."""
        (x, y, z), (a, b, c, d, e, f) = p_WC, self._surely
        if a <= x <= d and b <= y <= e and c <= z <= f:
            return p_WC
        p_WE = to_pose(p_WC, q_WE, self._p_EC)[:3, 3]
        inside = np.clip(p_WE, self._low, self._high)
        return p_WC if np.array_equal(inside, p_WE) else as_vector3(np.array(p_WC) + inside - p_WE)
