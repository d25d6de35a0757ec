# SPDX-License-Identifier: Apache-2.0
"""Whether two ways of knowing one wrench agree: a chi-square test on the mean of their difference over a window.

Random errors go down with the number of independent samples; systematic ones (a mass, a sensor's gain) do not, and
stand beside them in the covariance of the mean.
"""

from collections import deque
from math import inf
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, length

WINDOW = 4.0  # [s] that the mean is over
INDEPENDENT = 0.2  # [s] apart from each other, samples count as independent: errors of neighbouring images are alike
_LEAST = 5  # samples
_SIGNIFICANT = 14.0  # chi-square of three components that one agreement in 300 reaches ...
_IN_A_ROW = 4  # ... and so many in a row, each beyond the tolerance besides, much fewer
_SPOKEN = 1.0  # [s] for which words stay before they are said anew
_AXES = "xyz"


class MeanDifference(NamedTuple):
    """Mean over the window, each (6,) of (torque, force): difference and its standard deviations [N m, N]."""

    mean: Array
    deviation: Array


class WindowTest:
    """`add` differences; `told` says which component is off, once they are `significant`.

    Attributes:
        significant: whether torque or force differs by more than its covariance and more than the tolerance.
        difference: mean and deviation over the window, None while there are too few samples.
    """

    def __init__(self, force_tolerance: float, torque_tolerance: float) -> None:
        """Differences below so many N and N m are not worth telling."""
        self._tolerance = torque_tolerance, force_tolerance
        self._samples: deque[tuple[float, Array, Array]] = deque()
        self._off = 0  # samples in a row at which the means differed
        self.significant = False
        self.difference: MeanDifference | None = None
        self._spoken = -inf

    def reset(self) -> None:
        """Forget what was seen."""
        self._samples.clear()
        self._off, self.significant, self.difference, self._spoken = 0, False, None, -inf

    def add(self, t: float, difference: Array, random: Array, systematic: Array, share: float = 0.0) -> None:
        """One sample at time t [s].

        Args:
            difference: (6,) of (torque, force). random, systematic: (6, 6) covariances of one sample.
            share: of the load, [N] of force that are not worth telling; 0: the tolerances alone.
        """
        samples = self._samples
        if samples and t < samples[-1][0]:  # the clock was set back
            self.reset()
        samples.append((t, difference, random))
        while samples[0][0] < t - WINDOW:
            samples.popleft()
        if len(samples) < _LEAST:
            return
        independent = 1.0 + (t - samples[0][0]) / INDEPENDENT
        n = len(samples)
        mean = sum((s[1] for s in samples), np.zeros(6)) / n
        C = sum((s[2] for s in samples), np.zeros((6, 6))) / (n * independent) + systematic
        self.difference = MeanDifference(mean, np.sqrt(C.diagonal()))
        off = False
        for half, tolerance in ((slice(0, 3), self._tolerance[0]), (slice(3, 6), self._tolerance[1])):
            d = mean[half]
            off |= float(d @ np.linalg.solve(C[half, half], d)) > _SIGNIFICANT and length(d) > max(
                tolerance, share if half.start else 0.0
            )
        self._off = self._off + 1 if off else max(self._off - 1, 0) if self.significant else 0
        self.significant = self._off >= _IN_A_ROW or (self.significant and self._off > 0)
        if not self.significant:
            self._spoken = -inf

    def to_be_told(self, t: float) -> bool:
        """Whether there are new words to say at time t [s]: once significant, and from time to time."""
        if not self.significant or 0.0 <= t - self._spoken < _SPOKEN:
            return False
        self._spoken = t
        return True

    def told(self) -> str:
        """The largest difference by its deviation, in words: 'along z by 1.98 +- 0.12 N'."""
        assert self.difference is not None
        mean, deviation = self.difference
        i = int(np.argmax(np.abs(mean) / deviation))
        way, unit = ("about", "N m") if i < 3 else ("along", "N")
        digits = 3 if i < 3 else 2
        return f"{way} the tool's {_AXES[i % 3]} by {mean[i]:+.{digits}f} +- {deviation[i]:.{digits}f} {unit}"
