# SPDX-License-Identifier: Apache-2.0
"""The gripper model of the hand (Fig. 2 of the paper): its width tells the pressure in the bubbles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from seed_core.spatial import Array

FloatOrArray = TypeVar("FloatOrArray", float, Array)


@dataclass(frozen=True)
class GripperPressure:
    """Pressure of both bubbles: it rises linearly as the gripper closes and squeezes them.

    Attributes:
        width: [m] some width; pressure: [hPa] the absolute pressure there.
        slope: [hPa/m] rise of pressure per closed metre, 0 or more.
    """

    width: float
    pressure: float
    slope: float

    def at_width(self, width: FloatOrArray) -> FloatOrArray:
        """Pressure [hPa] at a gripper width [m]."""
        return self.pressure + self.slope * (self.width - width)
