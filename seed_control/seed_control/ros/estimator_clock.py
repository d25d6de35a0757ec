# SPDX-License-Identifier: Apache-2.0
"""Asks the estimator what time it is, a few times a second; it may run on another computer."""

from math import inf

from sensor_msgs.msg import TimeReference

from seed_control.monitor.clock_skew import ClockSkew, SkewSettings
from seed_ros import COMMAND, SeedNode
from seed_ros.conversions import seconds, stamped


class EstimatorClock:
    """`look` in each step; `skew` says what came out.

    In simulated time there is one clock. An estimator that does not answer leaves the skew unknown.
    """

    def __init__(self, node: SeedNode, settings: SkewSettings) -> None:
        self.skew = ClockSkew(settings.max_skew)
        self._node = node
        one_clock = node.get_parameter("use_sim_time").get_parameter_value().bool_value
        self._period = inf if one_clock or not settings.rate else 1.0 / settings.rate
        self._asked = -inf  # [s]
        self._questions = node.publisher(TimeReference, "clock_question", COMMAND)
        node.loop.poll(TimeReference, "clock_answer", self._on_answer, COMMAND)

    def look(self, now: float) -> None:
        """Ask again if it is time; now [s]."""
        self.skew.look(now)
        if 0.0 <= now - self._asked < self._period or self._period == inf:
            return
        self._asked = now
        self._questions.publish(stamped(TimeReference, now, ""))

    def _on_answer(self, message: TimeReference) -> None:
        if message.time_ref.sec or message.time_ref.nanosec:
            self.skew.add(seconds(message.time_ref), seconds(message.header.stamp), self._node.now())

    def values(self) -> dict[str, object]:
        """For the diagnostics."""
        if not self.skew.known:
            return {"clock_skew_ms": "", "clock_skew_within_ms": ""}
        return {
            "clock_skew_ms": round(1e3 * self.skew.offset, 2),
            "clock_skew_within_ms": round(1e3 * self.skew.within, 2),
        }
