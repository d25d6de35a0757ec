# SPDX-License-Identifier: Apache-2.0
"""A new stiffness taken over gradually, so that the arm does not jump."""

from __future__ import annotations

from dataclasses import dataclass

from seed_core.bushing import Stiffness


@dataclass(frozen=True)
class Blend:
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
        pairs = zip(self.old.rotation + self.old.translation, self.new.rotation + self.new.translation, strict=True)
        a, b, c, d, e, f = ((1.0 - s) * old + s * new for old, new in pairs)
        return Stiffness((a, b, c), (d, e, f))
