# SPDX-License-Identifier: Apache-2.0
"""The stiffness in use: the one that belongs to the present grip, and a new one taken over without a jump."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.config import ConfigError, field
from seed_core.stiffness_file import GripStiffness

_WORTHWHILE = 0.005  # relative change of any stiffness that is passed on; less is noise of the pressure


@dataclass(frozen=True)
class ScheduleSettings:
    """Where the stiffness comes from while the grip changes."""

    file: str = field("", doc="stiffness.yaml of the identification; empty: the stiffness stays as it is given")
    follow: str = field("pressure", choices=("pressure", "width"), doc="what tells the grip")


class ScheduleFollower:
    """Turns measured pressures or widths into changes of stiffness that are worth passing on.

    Attributes:
        pressures: of the identified grips [hPa]; empty where they are unknown.
    """

    def __init__(self, stiffness: GripStiffness, follow: str) -> None:
        """Raises ConfigError: pressure is to tell the grip, and the grips of the file have none."""
        if follow == "pressure" and not stiffness.file.by_pressure:
            raise ConfigError(
                "the grips of stiffness.yaml have no pressures: set grip.follow to width, or identify with pressures"
            )
        self._at = stiffness.at_pressure if follow == "pressure" else stiffness.at_width
        self.pressures = [g.pressure_hpa for g in stiffness.file.grips if g.pressure_hpa > 0.0]
        self._passed: np.ndarray | None = None

    def update(self, value: float) -> Stiffness | None:
        """A measured pressure [hPa] or width [m]; the stiffness if it differs from the one passed on last.

        Raises:
            ConfigError: the value is not finite, or no width of a gripper.
        """
        stiffness = self._at(value)
        now = stiffness.vector()
        if self._passed is not None and float(np.abs(now / self._passed - 1.0).max()) < _WORTHWHILE:
            return None
        self._passed = now
        return stiffness


class StiffnessBlend(NamedTuple):
    """From one stiffness to another over duration [s] from start [s]."""

    old: Stiffness
    new: Stiffness
    start: float
    duration: float

    def share(self, t: float) -> float:
        """How much of the new one is in use at time t [s]; one when it is done."""
        return min(max((t - self.start) / self.duration, 0.0), 1.0) if self.duration > 0.0 else 1.0

    def at(self, t: float) -> Stiffness:
        """Stiffness in use at time t [s]."""
        s = self.share(t)
        return Stiffness.from_vector((1.0 - s) * self.old.vector() + s * self.new.vector())
