# SPDX-License-Identifier: Apache-2.0
"""The pressures of both bubbles, put beside the motion of their membranes."""

from dataclasses import replace
from functools import partial
from math import isfinite, nan

from std_msgs.msg import Float32

from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import FINGERS
from seed_ros import SENSOR, SeedNode

OLDEST = 0.5  # [s] of a reading that still counts


class BubblePressures:
    """Subscribes to bubble_left/pressure and bubble_right/pressure [hPa]."""

    def __init__(self, node: SeedNode) -> None:
        self._node = node
        self._newest: dict[str, tuple[float, float]] = {}  # when it came [s] and value, by finger
        for finger in FINGERS:
            receive = partial(self._receive, finger)
            node.loop.poll(Float32, f"bubble_{finger}/pressure", receive, SENSOR)

    def _receive(self, finger: str, message: Float32) -> None:
        self._newest[finger] = self._node.now(), float(message.data)

    def into(self, estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        """The estimate with the pressure of each membrane that tells none."""
        if not estimate.valid:
            return estimate
        told = (m if isfinite(m.pressure) else replace(m, pressure=self._of(m.finger)) for m in estimate.membrane)
        return replace(estimate, membrane=tuple(told))

    def _of(self, finger: str) -> float:
        when, value = self._newest.get(finger, (-1e9, nan))
        return value if 0.0 <= self._node.now() - when < OLDEST else nan
