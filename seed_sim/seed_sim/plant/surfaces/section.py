# SPDX-License-Identifier: Apache-2.0
"""What a scenario says of the table's shape; ranges are drawn from the seed."""

from dataclasses import dataclass

from seed_core.config import field

Range = tuple[float, float]
KINDS = ("plane", "cylinder", "sphere", "saddle", "relief", "wedge", "step")


@dataclass(frozen=True)
class SurfaceSection:
    """The shape of the table, in its frame S: x along the wipe, z out of it."""

    kind: str = field(
        "plane",
        choices=KINDS,
        doc="cylinder along y; saddle; relief: smooth hills of random height; wedge: a roof across x; step: across x",
    )
    radius: Range = field(
        (0.08, 0.5), unit="m", low=0.02, high=10.0, span=True, doc="of cylinder and sphere; of a saddle's both bends"
    )
    hollow: bool = field(False, doc="cylinder and sphere are seen from inside")
    at: Range = field(
        (0.0, 0.03), unit="m", low=-1.0, high=1.0, span=True, doc="x of the highest or lowest line, or of the step"
    )
    turn: Range = field((-20.0, 20.0), unit="deg", low=-180.0, high=180.0, span=True, doc="of the shape about z")
    slope: Range = field((4.0, 8.0), unit="deg", low=0.0, high=20.0, span=True, doc="rms of a relief's")
    wavelength: Range = field((0.1, 0.3), unit="m", low=0.05, high=2.0, span=True, doc="of a relief's hills")
    angle: float = field(20.0, unit="deg", low=1.0, high=40.0, doc="by which both sides of a wedge are inclined")
    rise: float = field(0.05, unit="m", low=0.005, high=1.0, doc="way from a wedge's foot to its ridge, along x")
    step: float = field(2.0, unit="mm", low=-20.0, high=20.0, doc="height of a step up, seen along x; below zero down")
    swing: float = field(0.0, unit="mm", low=0.0, high=20.0, doc="amplitude of the table that moves up and down")
    frequency: float = field(0.5, unit="Hz", low=0.0, high=5.0, doc="of that motion; its phase is drawn")

    @property
    def flat(self) -> bool:
        """Whether it is a plane at rest."""
        return self.kind == "plane" and self.swing == 0.0
