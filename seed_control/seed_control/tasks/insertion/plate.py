# SPDX-License-Identifier: Apache-2.0
"""The plate under a sliding tip, found while it slides, and how far the tip has dropped below it."""

import numpy as np

from seed_core.spatial import Array

_SLOPE = 0.05  # deviation of the plate's slope before anything is known of it
_NOISE = 5e-4  # [m] of an image's height
_SHARE = 0.3  # of an image in the drop that is told
_LEAST = 0.4  # of the drop that is looked for, beyond which an image says nothing of the plate


class PlateUnderTip:
    """The plane z = c + a x + b y, by recursive least squares over the images.

    Attributes:
        dropped: [m] by how much the tip is below it, over some images.
    """

    def __init__(self, drop: float) -> None:
        """drop: [m] that is looked for."""
        self._most = _LEAST * drop
        self._origin: Array | None = None  # (3,) first place of the tip
        self._plane = np.zeros(3)
        self._covariance = np.diag((_NOISE**2, _SLOPE**2, _SLOPE**2))
        self.dropped = 0.0

    def image(self, tip: Array) -> None:
        """Take in the tip's place (3,) [m], z out of the plate."""
        if self._origin is None:
            self._origin = tip.copy()
            return
        x, y, z = tip - self._origin
        seen = np.array((1.0, x, y))
        below = float(seen @ self._plane - z)
        self.dropped += _SHARE * (below - self.dropped)
        if self.dropped < self._most:
            gain = self._covariance @ seen / (seen @ self._covariance @ seen + _NOISE**2)
            self._plane = self._plane - gain * below
            self._covariance = self._covariance - np.outer(gain, seen @ self._covariance)

    def height(self, tip: Array) -> float:
        """Of the plate [m] over or under a place (3,)."""
        if self._origin is None:
            return float(tip[2])
        x, y, _ = tip - self._origin
        return float(self._origin[2] + self._plane @ (1.0, x, y))
