# SPDX-License-Identifier: Apache-2.0
"""What must make the arm hold while it moves: an overloaded grasp, and a way without contact that gets too long."""

from __future__ import annotations

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_control.wrench.estimate import Measurement
from seed_core.spatial import Array, rpy_from_rotation
from seed_core.vector3 import Vector3, minus

_IMAGES = 3  # in a row that must agree on an overload


class Guard:
    """Each check returns why the arm must hold; empty while it may go on."""

    def __init__(self, parameters: ControllerParameters) -> None:
        self._parameters = parameters
        self._too_far = 0
        self._free_from: Vector3 | None = None  # commanded position at which the approach without contact began

    def overload(self, m: Measurement) -> str:
        """Per image: the grasp is deflected or loaded beyond what it endures, in three images in a row."""
        p = self._parameters
        force = float(np.sqrt(m.on_environment.force @ m.on_environment.force))
        deflection = float(np.sqrt(m.X_TC[:3, 3] @ m.X_TC[:3, 3]))
        angle = float(np.rad2deg(np.abs(rpy_from_rotation(m.X_TC[:3, :3])).max()))
        over = (
            f"estimated force {force:.1f} N is beyond {p.max_measured_force:g} N"
            if force > p.max_measured_force
            else f"deflection {1e3 * deflection:.1f} mm is beyond {1.2e3 * p.max_deflection:.1f} mm: the tool may slip"
            if deflection > 1.2 * p.max_deflection
            else f"rotation {angle:.0f} degrees in the grasp is beyond {1.2 * p.max_rotation:.0f}: the tool may slip"
            if angle > 1.2 * p.max_rotation
            else ""
        )
        self._too_far = self._too_far + 1 if over else 0
        return over if self._too_far >= _IMAGES else ""

    def arrived(self) -> None:
        """The tool touches, or nothing is sought: the next approach is counted from its own start."""
        self._free_from = None

    def free_travel(self, p_WC: Vector3, normals: Array) -> str:
        """Per step of an approach: the command p_WC [m] has gone too far along the force directions normals (m, 3)."""
        if self._free_from is None:
            self._free_from = p_WC
        travel = normals @ minus(p_WC, self._free_from)
        bound = self._parameters.max_free_travel
        if float(np.sqrt(travel @ travel)) <= bound:
            return ""
        return (
            f"no contact within max_free_travel = {1e3 * bound:.0f} mm: start nearer to the surface, or check the "
            "estimate"
        )
