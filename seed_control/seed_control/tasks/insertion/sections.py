# SPDX-License-Identifier: Apache-2.0
"""The sections `search` and `insert` of a phase, with units."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field
from seed_core.vector3 import ZERO, Vector3

PATTERNS = ("here", "spiral", "line", "tilt")


@dataclass(frozen=True)
class Search:
    """Sliding over a plate until the tip drops into something, or runs against it sideways."""

    pattern: str = field("spiral", choices=PATTERNS, doc="press in place; Archimedean spiral; straight line; tilt")
    radius: float = field(0.004, unit="m", quantity=True, low=1e-4, high=0.1, doc="of the spiral, at most")
    pitch: float = field(0.001, unit="m", quantity=True, low=5e-5, high=0.02, doc="between turns of the spiral")
    along: Vector3 = field(ZERO, unit="m", quantity=True, low=-0.3, high=0.3, doc="the line, from its start")
    angle: float = field(3.0, unit="deg", quantity=True, low=0.1, high=20.0, doc="of tilting, at most")
    drop: float = field(8e-4, unit="m", quantity=True, low=2e-4, high=0.05, doc="of the tip below the plate: found")
    within: float = field(0.003, unit="m", quantity=True, low=0.0, high=0.05, doc="of z = 0 the plate is known to lie")
    rim: float = field(
        2.5, unit="N", quantity=True, low=0.3, high=50.0, doc="sideways beyond which a rim is felt: found"
    )

    def __post_init__(self) -> None:
        if self.pattern == "line" and not any(self.along):
            raise ConfigError("a search along a line needs its end: give along, from the line's start")
        if self.pattern == "spiral" and self.pitch > self.radius:
            raise ConfigError(f"pitch = {self.pitch} m is beyond radius = {self.radius} m: the spiral has no turn")


@dataclass(frozen=True)
class Insert:
    """Pushing along the force until a depth is reached."""

    depth: float = field(unit="m", quantity=True, low=1e-3, high=0.3, doc="of the tip below the plate: done")
    tolerance: float = field(5e-4, unit="m", quantity=True, low=1e-4, high=5e-3, doc="of the depth")
    tries: int = field(4, low=0, high=50, doc="after jams and wedges; then it fails and lifts")
    back_off: float = field(0.002, unit="m", quantity=True, low=2e-4, high=0.02, doc="before the next try")
    correction: float = field(1.0, unit="deg", quantity=True, low=0.0, high=5.0, doc="of the tilt after a jam")
    searches: int = field(2, low=0, high=20, doc="more, where it comes no deeper than the mouth")
    turn: float = field(2.0, unit="deg", quantity=True, low=0.0, high=20.0, doc="about the axis after a wedge")
    stuck: float = field(0.6, unit="s", quantity=True, low=0.1, high=10.0, doc="with force but without progress")
