# SPDX-License-Identifier: Apache-2.0
"""Whether a tool that stands on a surface is told to be higher or lower from one image to the next.

A surface has steps, but a tip that stands does not cross them. So the tool was pushed, has slid in the grasp, or poses
are wrong since; in the last two cases the force is. Smaller steps show here than in a single pair of images: means of
some before and after are compared, and a motion that goes on for longer (a table that moves) is no step.
"""

from collections import deque
from math import sqrt

import numpy as np

from seed_control.wrench.estimate import Measurement
from seed_core.spatial import Array

_IMAGES = 8  # before, and after
_STANDS = 1e-3  # [m] that the gripper goes along the force until then, and gripper or tip across from before to after
_CERTAIN = 6.0  # deviations of the difference of the means
_DRIFTS = 0.4  # share of the step, by which the height may change in the same sense before it, and after it
_SHARE, _LEAST = 0.2, 0.5  # of the wanted force, and [N]: what it would be off by
_LARGE = 7.0  # deviations of an image, from which on it holds
_LEAST_DEVIATION = 2e-4  # [m] of an image, whatever is stated: a peg at a hole's rim moves by more than none
_PRESSES = 0.3  # of the wanted force: with less after the step, contact was lost at once


class PoseStep:
    """Along one force direction. `update` with each image in which the tool touches, `clear` with any other.

    Attributes:
        warning: the largest step since it was enabled; '' for none. reason: the same where it makes the arm hold.
    """

    def __init__(self) -> None:
        self.warning = self.reason = ""
        self._largest = 0.0  # [N]
        self._recent: deque[tuple[Array, float]] = deque(maxlen=2 * _IMAGES)  # see `update`

    def clear(self) -> None:
        """It does not touch."""
        self._recent.clear()

    def update(self, m: Measurement, n: Array, wanted: float, p_Ttip: Array, stiffness: float) -> None:
        """Take in an image.

        Args:
            n: (3,) unit vector of the force in W. wanted: force along it [N]. stiffness: of the grasp [N/m].
        """
        gripper, force = m.X_WC[:3, 3], m.on_environment.force
        # Places of T, C, and the tip by C [m], the force [N]; and the variance of a place [m^2].
        self._recent.append((np.stack((m.X_WT[:3, 3], gripper, gripper + m.X_WC[:3, :3] @ p_Ttip, force)), m.variance))
        if len(self._recent) < 2 * _IMAGES:
            return
        seen = np.array([rows for rows, _ in self._recent])
        step = _step(seen[:, 0] @ n, seen[:, 1] @ n)
        deviation, off = sqrt(sum(v for _, v in self._recent)) / _IMAGES, stiffness * abs(step)
        if abs(step) <= _CERTAIN * deviation or off <= max(_SHARE * abs(wanted), _LEAST, self._largest):
            return
        presses = float((seen[_IMAGES:, 3] @ n).mean()) * wanted >= _PRESSES * wanted * wanted
        if presses and _stands(seen[:, 1:3], n) and _sudden(seen[:, 0] @ n, step):
            self._largest = off
            self.warning = (
                f"the tool has moved by {1e3 * abs(step):.1f} mm along the force at once, though the gripper stood: "
                f"unless something pushed it, poses are wrong since, and the force is off by {off:.1f} N"
            )
            if abs(step) > _LARGE * max(sqrt(m.variance), _LEAST_DEVIATION):
                self.reason = self.warning


def _step(heights: Array, gripper: Array) -> float:
    """By how much the mean height (N,) changed [m], beyond what the gripper's (N,) does while it changed.

    A soft surface gives way to the gripper; to a step the gripper answers some images later.
    """
    step = float(heights[_IMAGES:].mean() - heights[:_IMAGES].mean())
    along = float(gripper[_IMAGES + 1] - gripper[_IMAGES - 2])
    return step - min(max(step, min(along, 0.0)), max(along, 0.0))


def _stands(places: Array, n: Array) -> bool:
    """Whether gripper and tip, (N, 2, 3), did: not pressed on, nor both across n (3,); it may turn about either."""
    if float(np.ptp(places[: _IMAGES + 1, 0] @ n)) > _STANDS:  # a peg that sticks slips on as it is pressed
        return False
    ways = places[_IMAGES:].mean(axis=0) - places[:_IMAGES].mean(axis=0)
    across = ways - np.outer(ways @ n, n)
    return float((across * across).sum(axis=1).min()) <= _STANDS**2


def _sudden(heights: Array, step: float) -> bool:
    """Whether it lies between two images: neither half of those before nor of those after differs by much of it."""
    a, b, c, d = heights.reshape(4, _IMAGES // 2).mean(axis=1).tolist()
    return bool(max((b - a) / step, (d - c) / step) < _DRIFTS)
