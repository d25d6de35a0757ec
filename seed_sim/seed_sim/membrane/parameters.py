# SPDX-License-Identifier: Apache-2.0
"""Every number of a bubble with mechanics. Sources and the ranges of random membranes: docs/membrane.md."""

from dataclasses import dataclass, replace

import numpy as np

from seed_core.config import ConfigError, field
from seed_core.errors import SeedError


class MembraneError(SeedError):
    """A membrane that cannot be inflated, that the tool pierces, or that finds no equilibrium."""


@dataclass(frozen=True)
class MembraneParameters:
    """Sheet, gas, friction and grip of both bubbles of a hand, and by how much they are not alike."""

    # sheet
    Et: float = field(700.0, unit="N/m", low=50.0, high=20000.0, doc="Young's modulus times thickness")
    thickness: float = field(0.0005, unit="m", low=5e-5, high=0.003, doc="of the sheet; turns tension into stress")
    poisson: float = field(0.45, low=0.0, high=0.49, doc="Poisson's ratio of the sheet")
    moulded: float = field(0.027, unit="m", low=0.005, high=0.06, doc="height of the stress-free dome over its rim")
    exponent: float = field(0.75, low=0.5, high=1.0, doc="of the dome's profile (1 - r^2)^exponent; 0.5: ellipsoid")
    rim_x: float = field(0.057, unit="m", low=0.01, high=0.2, doc="semi-axis of the rim along x_C")
    rim_z: float = field(0.040, unit="m", low=0.01, high=0.2, doc="semi-axis of the rim along z_C")
    creep: float = field(0.0, low=0.0, high=0.5, doc="share of a held strain's stress that relaxes")
    creep_time: float = field(2.0, unit="s", low=0.05, high=1000.0, doc="time constant of the creep")

    # gas
    pressure: float = field(3500.0, unit="Pa", low=200.0, high=20000.0, doc="above the ambient, free bubble")
    ambient: float = field(101325.0, unit="Pa", low=50000.0, high=110000.0, doc="absolute pressure around")
    dead_volume: float = field(0.0001, unit="m^3", low=0.0, high=0.01, doc="of housing and hose, beside the dome's")
    leak: float = field(0.0, unit="Pa/s", low=0.0, high=1000.0, doc="fall of the pressure at constant volume")

    # contact
    friction: float = field(1.0, low=0.0, high=5.0, doc="Coulomb's coefficient between sheet and tool")
    normal_stiffness: float = field(1e8, unit="N/m^3", low=1e6, high=1e10, doc="pressure per penetration")
    shear_stiffness: float = field(1e8, unit="N/m^3", low=1e6, high=1e10, doc="shear stress per displacement, sticking")
    edge: float = field(0.002, unit="m", low=0.0002, high=0.03, doc="radius of the edges of box and ends")

    # by what share the left bubble has more than said above, and the right one less
    unlike_sheet: float = field(0.0, low=-0.3, high=0.3, doc="of Et: the left sheet is stiffer, the right one softer")
    unlike_pressure: float = field(0.0, low=-0.3, high=0.3, doc="of pressure: the left bubble is fuller")
    unlike_friction: float = field(0.0, low=-0.3, high=0.3, doc="of friction: the left bubble sticks better")

    # grip
    squeeze: float = field(0.0065, unit="m", low=0.0005, high=0.025, doc="imprint of the tool in each bubble, grasped")

    # mesh and solver
    spacing: float = field(
        0.004, unit="m", low=0.001, high=0.012, doc="distance of neighbouring nodes on the flat sheet"
    )
    tolerance: float = field(1e-4, unit="N", low=1e-9, high=0.01, doc="norm of the nodes' unbalanced forces")
    step: float = field(0.001, unit="m", low=5e-5, high=0.01, doc="longest motion of the tool solved at once")

    def __post_init__(self) -> None:
        if self.squeeze >= self.moulded:
            raise ConfigError(f"squeeze = {self.squeeze:g} m must be less than the moulded height {self.moulded:g} m")
        if self.spacing > 0.35 * min(self.rim_x, self.rim_z):
            raise ConfigError(
                f"spacing = {self.spacing:g} m must be at most 0.35 of the shorter semi-axis of the rim, "
                f"{min(self.rim_x, self.rim_z):g} m"
            )

    def of(self, side: float) -> "MembraneParameters":
        """Of one bubble alone; side: +1 for the left one, -1 for the right one."""
        return replace(
            self,
            Et=self.Et * (1.0 + side * self.unlike_sheet),
            pressure=self.pressure * (1.0 + side * self.unlike_pressure),
            friction=self.friction * (1.0 + side * self.unlike_friction),
            unlike_sheet=0.0,
            unlike_pressure=0.0,
            unlike_friction=0.0,
        )


def random_membrane(seed: int, spacing: float = 0.004) -> MembraneParameters:
    """A membrane drawn from the ranges that docs/membrane.md justifies.

    Args:
        seed: of the draw; the same seed gives the same membrane.
        spacing: [m] of the nodes.
    """
    draw = np.random.default_rng((seed, 0x5EED))
    pressure = float(draw.uniform(2000.0, 4000.0))
    stretch = float(np.exp(draw.uniform(np.log(3.5), np.log(7.0))))  # [1/m]; a free dome of 30 to 34 mm
    return MembraneParameters(
        Et=pressure / stretch,
        thickness=float(draw.uniform(0.0004, 0.0006)),
        poisson=float(draw.uniform(0.40, 0.49)),
        moulded=float(draw.uniform(0.026, 0.028)),
        exponent=float(draw.uniform(0.70, 0.80)),
        pressure=pressure,
        dead_volume=float(draw.uniform(0.00005, 0.0002)),
        friction=float(draw.uniform(0.7, 1.5)),
        squeeze=float(draw.uniform(0.0055, 0.0085)),
        creep=float(draw.uniform(0.0, 0.1)),
        spacing=spacing,
    )


def unlike_fingers(membrane: MembraneParameters, seed: int) -> MembraneParameters:
    """The same with fingers that are not quite alike, drawn from the ranges that docs/membrane.md tells."""
    draw = np.random.default_rng((seed, 0xF1F2))
    sheet, pressure, friction = (float(draw.uniform(-most, most)) for most in (0.05, 0.02, 0.1))
    return replace(membrane, unlike_sheet=sheet, unlike_pressure=pressure, unlike_friction=friction)
