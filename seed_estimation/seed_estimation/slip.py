# SPDX-License-Identifier: Apache-2.0
"""No-slip (Assumption 1 of the paper) is checked, not assumed.

Micro-slip: while the tool moves, the membrane in contact follows a constant share of its motion along the surface. The
image sees the membrane and depth sees the tool, so wherever depth sees the motion at all the share can be learnt: a
scalar Kalman filter, of a second or two. A share below a few per cent cannot be told from depth's own errors and is
not corrected.

Gross slip, where the membrane lets go, is `gross_slip`'s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

START_DEVIATION = 0.10  # [1] bubbles stick, as a rule
WANDER = 0.02  # [1/sqrt(s)] how fast the share may change
DOUBT = 20.0  # frames are not independent: one frame's information counts this much less
SYSTEMATIC = 0.05  # [1] what depth's own errors pretend in one frame, however sure it is
ALIKE = 0.25  # [s] over which those errors stay what they are: so much of the motion tells a share once
ON, OFF = 0.06, 0.04  # [1] shares from which the correction is applied, and below which it is left again


@dataclass
class MicroSlip:
    """Share of the tool's motion that the membrane does not follow: `value` is what is corrected for.

    `variance` makes the filter quick, as if frames erred independently; `doubt` is the variance that may be believed.
    """

    most: float
    estimate: float = 0.0
    variance: float = START_DEVIATION**2
    value: float = 0.0
    doubt: float = START_DEVIATION**2

    def update(self, step: float, information: float, dt: float) -> None:
        """Takes one frame's demand: change the value by `step`, sure to `information` [1]."""
        wander = WANDER**2 * max(dt, 0.0)
        self.variance, self.doubt = self.variance + wander, min(self.doubt + wander, START_DEVIATION**2)
        if dt <= 0.0 or information <= 0.0 or not np.isfinite(step):
            return
        noise = DOUBT / information + SYSTEMATIC**2
        gain = self.variance / (self.variance + noise)
        demand = self.estimate + gain * (self.value + min(max(step, -0.5), 0.5) - self.estimate)
        self.estimate = max(demand, 0.0)  # no membrane runs ahead of the tool
        self.variance *= 1.0 - gain
        self.doubt *= 1.0 - self.doubt / (self.doubt + noise * max(ALIKE / dt, 1.0))
        applied = self.estimate > (OFF if self.value > 0.0 else ON)
        self.value = min(self.estimate, self.most) if applied else 0.0

    @property
    def deviation(self) -> float:
        """Of the value [1]: what the filter does not know, or does not correct."""
        return float(np.hypot(np.sqrt(self.doubt), max(self.estimate, 0.0) if self.value == 0.0 else 0.0))
