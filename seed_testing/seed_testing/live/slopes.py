# SPDX-License-Identifier: Apache-2.0
"""Whether a quantity of a long run stays level: a line through its samples, with what it may rise."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

WARM = 0.25  # of the run in which caches fill, and which is left out
FEWEST = 12  # samples after that


class Slope(NamedTuple):
    """A line through samples."""

    rate: float  # [1/h]
    deviation: float  # [1/h] standard deviation of the rate, where neighbouring samples are alike
    first: float  # of the line, at its beginning and its end
    last: float

    def rises(self, allowed: float) -> bool:
        """Whether it surely rises by more than `allowed` [1/h]."""
        return self.rate - 2.0 * self.deviation > allowed


def slope(hours: ArrayLike, values: ArrayLike) -> Slope | None:
    """The line through what was sampled after the warm-up; None for too few samples.

    Args:
        hours: (n,) times [h]. values: (n,).
    """
    t, v = np.asarray(hours, dtype=float), np.asarray(values, dtype=float)
    late = t >= t[0] + WARM * (t[-1] - t[0]) if len(t) else np.zeros(0, dtype=bool)
    t, v = t[late], v[late]
    if len(t) < FEWEST:
        return None
    rate, start = np.polyfit(t - t[0], v, 1)
    rest = v - start - rate * (t - t[0])
    spread = float(np.sum((t - t.mean()) ** 2))
    variance = float(rest @ rest) / (len(t) - 2)
    alike = float(rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-30)  # steps stay for many samples
    stretched = (1.0 + max(alike, 0.0)) / max(1.0 - alike, 0.05)
    deviation = float(np.sqrt(variance * stretched / spread))
    return Slope(float(rate), deviation, float(start), float(start + rate * (t[-1] - t[0])))
