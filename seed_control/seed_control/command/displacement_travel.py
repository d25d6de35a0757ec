# SPDX-License-Identifier: Apache-2.0
"""How far the gripper may go towards a wanted displacement of the grasp that nothing resists.

A tool that is free goes with the gripper, which would follow it on and on.
"""

from math import degrees

import numpy as np

from seed_core.arm.quaternion import Quaternion, turn_between
from seed_core.bushing import Stiffness
from seed_core.spatial import Array, so3_log
from seed_core.vector3 import Vector3, minus, norm

_REACHED = 0.7  # share of the wanted displacement from which on something resists it
_LEAST = 1e-3  # [J] of a wanted displacement: less is told from noise by nothing


class DisplacementTravel:
    """The way since the displacement was last reached: `image` with each image, `step` with each command."""

    def __init__(self, way: float, turn: float) -> None:
        """Bounds [m] and [deg]."""
        self._way, self._turn = way, turn
        self._start: tuple[Vector3, Quaternion] | None = None

    def restart(self) -> None:
        """It is counted from where the command is next."""
        self._start = None

    def image(self, wanted: Array, measured: Array, stiffness: Stiffness) -> None:
        """Take in an image: wanted and measured X_TC (4, 4)."""
        a, b, K = _vector(wanted), _vector(measured), stiffness.vector()
        energy = float(a @ (K * a))
        if energy > _LEAST and float(a @ (K * b)) > _REACHED * energy:
            self._start = None

    def step(self, p_WC: Vector3, q_WE: Quaternion) -> str:
        """Take in the commanded place of C [m] and rotation of the flange; why to hold, '' for nothing."""
        if self._start is None:
            self._start = p_WC, q_WE
        p, q = self._start
        way, turn = norm(minus(p_WC, p)), degrees(norm(turn_between(q_WE, q)))
        if way <= self._way and turn <= self._turn:
            return ""
        return (
            f"the displacement is not reached within max_free_travel = {1e3 * self._way:.0f} mm and max_drift = "
            f"{self._turn:g} degrees (gone: {1e3 * way:.0f} mm, {turn:.0f} degrees): nothing resists the tool there"
        )


def _vector(X: Array) -> Array:
    return np.concatenate((so3_log(X[:3, :3]), X[:3, 3]))
