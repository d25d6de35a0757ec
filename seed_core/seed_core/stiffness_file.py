# SPDX-License-Identifier: Apache-2.0
"""The identification's result, stiffness.yaml: the stiffness of one hand with one tool at several grips."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from pathlib import Path

import yaml

from seed_core.bushing import MODELS, Stiffness
from seed_core.config import ConfigError, field, load_file, to_mapping
from seed_core.vector3 import Vector3

HEADER = (
    "# SPDX-License-Identifier: Apache-2.0\n"
    "# Identified stiffness: N m/rad about, N/m along the axes; pressure in hPa, width in m.\n"
)


@dataclass(frozen=True)
class Grip:
    """Stiffness at one grip, with standard deviations (0 where unknown)."""

    pressure_hpa: float = field(unit="hPa", low=0.0, high=2000.0, doc="mean absolute pressure of both bubbles")
    width_m: float = field(unit="m", low=0.0, high=1.0, doc="gripper width")
    rotation: Vector3 = field(unit="N m/rad", low=1e-6, high=1e6, doc="about roll, pitch and yaw")
    translation: Vector3 = field(unit="N/m", low=1e-3, high=1e9, doc="along x, y and z")
    rotation_std: Vector3 = field((0.0, 0.0, 0.0), unit="N m/rad", low=0.0, high=1e6, doc="standard deviations")
    translation_std: Vector3 = field((0.0, 0.0, 0.0), unit="N/m", low=0.0, high=1e9, doc="standard deviations")

    @property
    def stiffness(self) -> Stiffness:
        return Stiffness(self.rotation, self.translation)


@dataclass(frozen=True)
class StiffnessFile:
    """A whole stiffness.yaml; grips stand in rising order of pressure."""

    hand: str = field(doc="name of the hand")
    tool: str = field(doc="name of the tool that was held")
    date: str = field(doc="when it was measured, ISO 8601 in quotes")
    grips: tuple[Grip, ...] = field(doc="at least one")
    model: str = field("midpoint", choices=MODELS, doc="stiffness map that was fitted")
    version: int = field(1, low=1, high=1, doc="of this format")

    def __post_init__(self) -> None:
        if not self.grips:
            raise ConfigError("grips is empty: at least one grip is needed")
        pressures = [g.pressure_hpa for g in self.grips]
        for a, b in pairwise(pressures):
            if not b > a:
                raise ConfigError(f"grips must stand in rising order of pressure_hpa; {b:g} hPa follows {a:g} hPa")


class GripStiffness:
    """Stiffness as a function of pressure or width: straight between the identified grips, constant beyond them."""

    def __init__(self, file: StiffnessFile) -> None:
        self.file = file
        self._by_pressure = sorted(file.grips, key=lambda g: g.pressure_hpa)
        self._by_width = sorted(file.grips, key=lambda g: g.width_m)

    def at_pressure(self, pressure_hpa: float) -> Stiffness:
        """Stiffness at a pressure [hPa]. Raises ConfigError when it is not finite."""
        return _between(self._by_pressure, [g.pressure_hpa for g in self._by_pressure], pressure_hpa, "pressure", "hPa")

    def at_width(self, width_m: float) -> Stiffness:
        """Stiffness at a gripper width [m]. Raises ConfigError when it is not finite."""
        return _between(self._by_width, [g.width_m for g in self._by_width], width_m, "width", "m")


def _between(grips: list[Grip], at: list[float], value: float, name: str, unit: str) -> Stiffness:
    if not isfinite(value):
        raise ConfigError(f"{name} = {value} {unit} must be finite")
    i = next((k for k in range(1, len(at)) if value < at[k]), len(at) - 1)
    if len(at) == 1 or value <= at[0]:
        return grips[0].stiffness
    share = min((value - at[i - 1]) / (at[i] - at[i - 1]), 1.0) if at[i] > at[i - 1] else 1.0
    r, t = (
        tuple(
            (1.0 - share) * a + share * b for a, b in zip(getattr(grips[i - 1], n), getattr(grips[i], n), strict=True)
        )
        for n in ("rotation", "translation")
    )
    return Stiffness((r[0], r[1], r[2]), (t[0], t[1], t[2]))


def load_stiffness(path: str | Path) -> StiffnessFile:
    """A stiffness.yaml. Raises ConfigError with file and line."""
    return load_file(path, StiffnessFile)


def save_stiffness(path: str | Path, file: StiffnessFile) -> None:
    """Write a stiffness.yaml whole or not at all."""
    target = Path(path)
    part = target.with_suffix(target.suffix + ".part")
    part.write_text(HEADER + yaml.safe_dump(to_mapping(file), sort_keys=False), encoding="utf-8")
    part.replace(target)
