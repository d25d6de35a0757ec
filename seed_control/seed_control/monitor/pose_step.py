# SPDX-License-Identifier: Apache-2.0
"""Whether a tool that stands on a surface is told to be higher or lower from one image to the next.

A surface has steps, but a tip that stands does not cross them. So the tool was pushed, has slid in the grasp, or poses
are wrong since; in the last two cases the force is. Smaller steps show here than in a single pair of images: means of
some before and after are compared, and a motion that goes on for longer (a table that moves) is no step.
"""

from collections import deque
from math import sqrt
from typing import NamedTuple

import numpy as np

from seed_control.wrench.estimate import Measurement
from seed_core.spatial import Array

_IMAGES = 8  # before, and after
_STANDS = 1e-3  # [m] that gripper or tip go across the force, at most, from before to after
_CERTAIN = 6.0  # deviations of the difference of the means
_DRIFTS = 0.4  # share of the step, by which the height may change in the same sense before it, and after it
_SHARE, _LEAST = 0.2, 0.5  # of the wanted force, and [N]: what it would be off by


class _Image(NamedTuple):
    """Height [m] of T along the force, places (2, 3) [m] of the gripper and of its tip, variance [m^2] of the height."""

    height: float
    places: Array
    variance: float


class PoseStep:
    """Along one force direction. `update` with each image in which the tool touches, `clear` with any other.

    Attributes:
        warning: the largest step since it was enabled; '' for none.
    """

    def __init__(self) -> None:
        self.warning, self._largest = "", 0.0
        self._recent: deque[_Image] = deque(maxlen=2 * _IMAGES)

    def clear(self) -> None:
        """It does not touch, or another direction counts."""
        self._recent.clear()

    def update(self, m: Measurement, n: Array, wanted: float, p_Ttip: Array, stiffness: float) -> None:
        """Take in an image.

        Args:
            n: (3,) unit vector of the force in W. wanted: force along it [N]. stiffness: of the grasp [N/m].
        """
        places = np.stack((m.X_WC[:3, 3], m.X_WC[:3, :3] @ p_Ttip + m.X_WC[:3, 3]))
        self._recent.append(_Image(float(m.X_WT[:3, 3] @ n), places, m.variance))
        if len(self._recent) < 2 * _IMAGES:
            return
        step, deviation = self._step(n)
        force = stiffness * abs(step)
        told = abs(step) > _CERTAIN * deviation and force > max(_SHARE * abs(wanted), _LEAST, self._largest)
        if told and self._sudden(step):
            self._largest = force
            self.warning = (
                f"the tool has moved by {1e3 * abs(step):.1f} mm along the force at once, though the gripper stood: "
                f"unless something pushed it, poses are wrong since, and the force is off by {force:.1f} N"
            )

    def _step(self, n: Array) -> tuple[float, float]:
        """By how much the mean height changed [m] beyond what the gripper's way at the step explains, and its deviation [m]."""
        images = list(self._recent)
        before, after = images[:_IMAGES], images[_IMAGES:]
        ways = np.sum([i.places for i in after], axis=0) / _IMAGES - np.sum([i.places for i in before], axis=0) / _IMAGES
        if min(float(way @ way) - float(way @ n) ** 2 for way in ways) > _STANDS**2:
            return 0.0, 0.0
        along = float((after[1].places[0] - before[-2].places[0]) @ n)  # before the gripper answers the step
        step = (sum(i.height for i in after) - sum(i.height for i in before)) / _IMAGES
        step -= min(max(step, min(along, 0.0)), max(along, 0.0))  # a soft surface gives way to the gripper
        return step, sqrt(sum(i.variance for i in images)) / _IMAGES

    def _sudden(self, step: float) -> bool:
        """Whether it lies between two images: neither half of those before nor of those after differs by much of it."""
        heights, half = [i.height for i in self._recent], _IMAGES // 2
        a, b, c, d = (sum(heights[i : i + half]) / half for i in range(0, 2 * _IMAGES, half))
        return max((b - a) / step, (d - c) / step) < _DRIFTS
