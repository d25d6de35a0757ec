# SPDX-License-Identifier: Apache-2.0
"""The section `hole` of a scenario."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field


@dataclass(frozen=True)
class HoleSection:
    """A plate on the table with one hole, and what of the tool goes into it; ranges are drawn from the seed."""

    shape: str = field("round", choices=("round", "box"), doc="of peg and hole across")
    width: tuple[float, float] = field(
        (0.016, 0.016), unit="m", low=2e-3, high=0.1, doc="of the peg along x and y of its tip; of a round one alike"
    )
    clearance: float = field(0.3, unit="mm", low=0.02, high=5.0, doc="by which the hole is wider, both sides together")
    depth: float = field(0.02, unit="m", low=1e-3, high=0.1, doc="of the hole")
    chamfer: float = field(0.5, unit="mm", low=0.0, high=5.0, doc="at the hole's mouth, 45 degrees")
    peg_chamfer: float = field(0.5, unit="mm", low=0.0, high=5.0, doc="at the peg's end, 45 degrees")
    away: float = field(3.0, unit="mm", low=0.0, high=50.0, doc="of the hole from the work frame's origin, at most")
    yaw: float = field(3.0, unit="deg", low=0.0, high=45.0, doc="of the hole about its axis, at most, either way")
    friction: tuple[float, float] = field((0.15, 0.35), low=0.0, high=2.0, span=True, doc="Coulomb, all of the contact")
    stiffness: float = field(1e4, unit="N/m", low=1e3, high=1e5, doc="of each contact point")
    drilled: bool = field(True, doc="false: the plate has no hole")

    def __post_init__(self) -> None:
        if self.shape == "round" and self.width[0] != self.width[1]:
            raise ConfigError(f"width = {self.width} m of a round hole must have two equal entries, its diameter")
        if 2e-3 * self.peg_chamfer >= min(self.width):
            raise ConfigError(f"peg_chamfer = {self.peg_chamfer} mm leaves nothing of a width of {min(self.width)} m")
