# SPDX-License-Identifier: Apache-2.0
"""Poses around the moment at which T becomes C anew: they must not be joined to those before.

A controller that presses would take the deflection for gone and press once more. So whoever publishes relative poses
tells none for a while: enough invalid ones to make a controller hold, for longer than it goes without a valid one.
Neither a lost message nor a slow camera lets it miss both.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

from seed_core.estimate import RelativePoseEstimate

LEAST = 10  # poses that are invalid; three in a row are enough
LASTING = 0.3  # [s]; a controller holds after 0.15 s without a valid pose


class Regrasp:
    """`begin` when a new grasp or reference is asked for, `end` when it is taken or given up."""

    def __init__(self) -> None:
        self._reason, self._open = "", False
        self._told, self._since = 0, inf

    def begin(self, what: str) -> None:
        """From the next pose on, until `end` and some time after it. what: 'grasp' or 'reference'."""
        self._reason = f"a new {what} is taken, deflections count from it: release what is pressed, then enable again"
        self._open, self._told, self._since = True, 0, inf

    def end(self) -> None:
        """The new grasp or reference counts from now on, or there is none."""
        self._open = False

    @property
    def under_way(self) -> bool:
        """Whether poses are not to be used yet."""
        return bool(self._reason)

    def through(self, estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        """What to publish in place of an estimate."""
        if not self._reason:
            return estimate
        self._since = min(self._since, estimate.stamp)
        if not self._open and self._told >= LEAST and estimate.stamp - self._since >= LASTING:
            self._reason = ""
            return estimate
        self._told += 1
        return replace(estimate, valid=False, reason=self._reason) if estimate.valid else estimate
