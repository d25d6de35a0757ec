# SPDX-License-Identifier: Apache-2.0
"""No-slip (Assumption 1 of the paper) is checked, not assumed.

Micro-slip: while the tool moves, the membrane in contact follows a constant share of its motion along the surface. The
image sees the membrane and depth sees the tool, so wherever depth sees the motion at all the share can be learnt: a
scalar Kalman filter, of a second or so. Depth's own errors pretend a share of a per cent where there is none, so an
estimate is shrunk as far as it is not clearly more than its deviation; smoothly, because a pose must not jump.

Gross slip, where the membrane lets go, is `gross_slip`'s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

START_DEVIATION = 0.10  # [1] bubbles stick, as a rule
WANDER = 0.02  # [1/sqrt(s)] how fast the share may change
DOUBT = 20.0  # pixels are not independent: a frame's information counts this much less
SYSTEMATIC = 0.02  # [1] what depth's own errors pretend, however sure the images are
ALIKE = 0.25  # [s] over which those errors stay what they are: so much of the motion tells a share once


@dataclass
class MicroSlip:
    """Share of the tool's motion that the membrane does not follow: `value` is what is corrected for."""

    most: float
    estimate: float = 0.0
    variance: float = START_DEVIATION**2
    value: float = 0.0

    def update(self, step: float, information: float, dt: float) -> None:
        """Takes one frame's demand: change the value by `step`, sure to `information` [1]."""
        self.variance = min(self.variance + WANDER**2 * max(dt, 0.0), START_DEVIATION**2)
        if dt <= 0.0 or information <= 0.0 or not np.isfinite(step):
            return
        gain = self.variance / (self.variance + DOUBT / information + SYSTEMATIC**2 * max(ALIKE / dt, 1.0))
        demand = self.estimate + gain * (self.value + min(max(step, -0.5), 0.5) - self.estimate)
        self.estimate = max(demand, 0.0)  # no membrane runs ahead of the tool
        self.variance *= 1.0 - gain
        self.value = min(self.estimate**3 / (self.estimate**2 + self.variance), self.most)

    @property
    def deviation(self) -> float:
        """Of the value [1]: what the filter does not know, or does not correct."""
        return float(np.hypot(np.sqrt(self.variance), self.estimate - self.value))
