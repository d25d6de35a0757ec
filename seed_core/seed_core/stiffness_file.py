# SPDX-License-Identifier: Apache-2.0
"""The identification's result, stiffness.yaml: the stiffness of one hand with one tool at several grips."""

from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from operator import attrgetter
from pathlib import Path

import numpy as np

from seed_core.bushing import MODELS, ROTATIONS, TRANSLATIONS, Stiffness
from seed_core.config import ConfigError, checked, field, load_saved, save_file
from seed_core.vector3 import Vector3

HEADER = (
    "# SPDX-License-Identifier: Apache-2.0\n"
    "# Identified stiffness: N m/rad about, N/m along the axes; pressure in hPa, width in m.\n"
)
MOST_PRESSURE, MOST_WIDTH = 2000.0, 1.0  # [hPa], [m] of a grip
MOST_UNEXPLAINED = 10.0  # share of a component's spread


@dataclass(frozen=True)
class IdentifiedGrip:
    """Stiffness at one grip, with standard deviations (0 where unknown)."""

    pressure_hpa: float = field(
        unit="hPa", low=0.0, high=MOST_PRESSURE, doc="mean absolute pressure of both bubbles; 0: unknown"
    )
    width_m: float = field(unit="m", low=0.0, high=MOST_WIDTH, doc="gripper width")
    rotation: Vector3 = field(unit="N m/rad", low=ROTATIONS[0], high=ROTATIONS[1], doc="about roll, pitch and yaw")
    translation: Vector3 = field(unit="N/m", low=TRANSLATIONS[0], high=TRANSLATIONS[1], doc="along x, y and z")
    rotation_std: Vector3 = field((0.0, 0.0, 0.0), unit="N m/rad", low=0.0, high=1e6, doc="standard deviations")
    translation_std: Vector3 = field((0.0, 0.0, 0.0), unit="N/m", low=0.0, high=1e9, doc="standard deviations")

    @property
    def stiffness(self) -> Stiffness:
        return Stiffness(self.rotation, self.translation)


@dataclass(frozen=True)
class StiffnessFile:
    """A whole stiffness.yaml; grips stand in rising order of pressure, or without pressures in falling one of width."""

    hand: str = field(doc="name of the hand")
    tool: str = field(doc="name of the tool that was held")
    date: str = field(doc="when it was measured, ISO 8601 in quotes")
    grips: tuple[IdentifiedGrip, ...] = field(doc="at least one")
    model: str = field("midpoint", choices=MODELS, doc="stiffness map that was fitted")
    torque_unexplained: Vector3 = field(
        (0.0, 0.0, 0.0),
        low=0.0,
        high=MOST_UNEXPLAINED,
        doc="share of the torques about x, y and z of T that the map leaves of poses the fit did not see; 0: unknown",
    )
    force_unexplained: Vector3 = field(
        (0.0, 0.0, 0.0), low=0.0, high=MOST_UNEXPLAINED, doc="likewise of the forces along x, y and z"
    )
    version: int = field(1, low=1, high=1, doc="of this format")

    def __post_init__(self) -> None:
        if not self.grips:
            raise ConfigError("grips is empty: at least one grip is needed")
        unknown = [g.pressure_hpa for g in self.grips].count(0.0)
        if 0 < unknown < len(self.grips):
            raise ConfigError(
                f"pressure_hpa is 0, that is unknown, of {unknown} of {len(self.grips)} grips: give all, or none"
            )
        for a, b in pairwise(self.grips):
            if self.by_pressure and not b.pressure_hpa > a.pressure_hpa:
                raise ConfigError(
                    f"grips must stand in rising order of pressure_hpa; {b.pressure_hpa:g} hPa follows "
                    f"{a.pressure_hpa:g} hPa"
                )
            if not self.by_pressure and not b.width_m < a.width_m:
                raise ConfigError(
                    "grips without pressure_hpa must stand in falling order of width_m; "
                    f"{b.width_m:g} m follows {a.width_m:g} m"
                )

    @property
    def by_pressure(self) -> bool:
        """Whether pressure tells the grips apart; one grip needs none."""
        return len(self.grips) == 1 or any(g.pressure_hpa > 0.0 for g in self.grips)


class GripStiffness:
    """Stiffness as a function of pressure or width: straight between the identified grips, constant beyond them."""

    def __init__(self, file: StiffnessFile) -> None:
        self.file = file

    def at_pressure(self, pressure_hpa: float) -> Stiffness:
        """Stiffness at a pressure [hPa]. Raises ConfigError when it is not finite, or the grips have no pressures."""
        if not self.file.by_pressure:
            raise ConfigError("the grips of stiffness.yaml have no pressures: let the stiffness follow the width")
        return self._at("pressure_hpa", pressure_hpa, "pressure", "hPa")

    def at_width(self, width_m: float) -> Stiffness:
        """Stiffness at a gripper width [m]. Raises ConfigError when it is not finite, or no width of a gripper."""
        if isfinite(width_m) and not 0.0 <= width_m <= MOST_WIDTH:
            raise ConfigError(f"width = {width_m:g} m must be within 0 and {MOST_WIDTH:g} m: is it in metres?")
        return self._at("width_m", width_m, "width", "m")

    def _at(self, key: str, value: float, name: str, unit: str) -> Stiffness:
        if not isfinite(value):
            raise ConfigError(f"{name} = {value} {unit} must be finite")
        grips = sorted(self.file.grips, key=attrgetter(key))
        at = [getattr(grip, key) for grip in grips]
        columns = np.array([grip.stiffness.vector() for grip in grips]).T
        return Stiffness.from_vector(np.array([np.interp(value, at, column) for column in columns]))


def load_stiffness(path: str | Path) -> StiffnessFile:
    """A stiffness.yaml. Raises ConfigError with file and line."""
    return load_saved(path, StiffnessFile, "stiffness file")


def save_stiffness(path: str | Path, file: StiffnessFile) -> None:
    """Write a stiffness.yaml whole or not at all. Raises ConfigError: it could not be loaded, and is not written."""
    save_file(path, HEADER, checked(file, "stiffness.yaml"))
