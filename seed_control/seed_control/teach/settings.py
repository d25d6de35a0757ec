# SPDX-License-Identifier: Apache-2.0
"""How closely a taught task follows its demonstration, and what is no demonstration."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field


@dataclass(frozen=True)
class TeachSettings:
    """Tolerances of the simplification, bounds of the check."""

    path: float = field(0.0003, unit="m", low=1e-5, high=0.01, doc="by which the path may be simplified")
    turn: float = field(
        6.0, unit="deg", low=0.2, high=30.0, doc="by which the tip's rotation may be simplified: a soft grasp leans"
    )
    force: float = field(0.4, unit="N", low=0.05, high=10.0, doc="half the band that counts as one force")
    touch: float = field(1.0, unit="N", low=0.2, high=20.0, doc="force at which the tool touches")
    resists: tuple[str, ...] = field(
        (), doc="axes of T about which the contact resists: they carry no torque, as x for a blade along y"
    )
    gap: float = field(0.3, unit="s", low=0.05, high=2.0, doc="longest time without a measurement")
    jump: float = field(0.8, unit="m/s", low=0.05, high=5.0, doc="speed of the tip that is a jump")
    turn_jump: float = field(180.0, unit="deg/s", low=10.0, high=2000.0, doc="turning of the tip that is a jump")
    force_jump: float = field(400.0, unit="N/s", low=10.0, high=10000.0, doc="change of force that is a jump")

    def __post_init__(self) -> None:
        if wrong := [axis for axis in self.resists if axis not in ("x", "y", "z")]:
            raise ConfigError(f"resists has '{wrong[0]}'; known: x, y, z")
