# SPDX-License-Identifier: Apache-2.0
"""No-slip (Assumption 1 of the paper) is checked, not assumed.

Micro-slip: while the tool moves, the membrane in contact follows a constant share of its motion along the surface. The
image sees the membrane and depth sees the tool, so wherever depth sees the motion at all the share can be learnt: a
scalar Kalman filter, slow, within [0, most].

Gross slip: the membrane lets go. Then image and depth disagree suddenly, or the image stops to be one rigid motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

START_DEVIATION = 0.10  # [1] bubbles stick, as a rule
WANDER = 0.006  # [1/sqrt(s)] how fast the share may change
DOUBT = 20.0  # frames are not independent: one frame's information counts this much less
SYSTEMATIC = 0.03  # [1] what depth's own errors pretend, however long one looks


@dataclass
class MicroSlip:
    """Share of the tool's motion that the membrane does not follow."""

    most: float
    value: float = 0.0
    variance: float = START_DEVIATION**2

    def update(self, step: float, information: float, dt: float) -> None:
        """Takes one frame's demand: change the share by `step`, sure to `information` [1]."""
        self.variance += WANDER**2 * max(dt, 0.0)
        if information <= 0.0 or not np.isfinite(step):
            return
        noise = DOUBT / information + SYSTEMATIC**2
        gain = self.variance / (self.variance + noise)
        self.value = min(max(self.value + gain * step, 0.0), self.most)
        self.variance *= 1.0 - gain
