# SPDX-License-Identifier: Apache-2.0
"""Asks the estimator what time it is, a few times a second; it may run on another computer."""

from contextlib import suppress
from math import inf

from sensor_msgs.msg import TimeReference

from seed_control.monitor.clock_skew import ClockSkew, SkewSettings
from seed_core.clocks import Clocks
from seed_ros import COMMAND, SeedNode
from seed_ros.conversions import seconds, stamped

ANSWERS = 2.0  # [s] within which an estimator that answers has done so; one without answers leaves the skew unknown


class EstimatorClock:
    """`look` in each step; `skew` says what came out.

    In simulated time there is one clock. An estimator that does not answer leaves the skew unknown.

    Attributes:
        not_taken_off: why force must wait for an offset that the estimator should take off the stamps; '' for nothing.
    """

    def __init__(self, node: SeedNode, settings: SkewSettings, clocks: Clocks) -> None:
        self.skew, self._clocks = ClockSkew(settings.max_skew), clocks
        self.not_taken_off = ""
        self._node = node
        one_clock = node.get_parameter("use_sim_time").get_parameter_value().bool_value
        self._period = inf if one_clock or not settings.rate else 1.0 / settings.rate
        self._asked = -inf  # [s]
        self._listens = inf  # [s] since when somebody listens to the questions
        self._questions = node.publisher(TimeReference, "clock_question", COMMAND)
        node.loop.poll(TimeReference, "clock_answer", self._on_answer, COMMAND)

    def look(self, now: float) -> None:
        """Ask again if it is time; now [s]."""
        self.skew.look(now)
        if 0.0 <= now - self._asked < self._period or self._period == inf:
            return
        self._asked = now
        if not self._questions.get_subscription_count():
            self._listens = inf
        elif self._listens == inf:
            self._listens = now
        self._questions.publish(stamped(TimeReference, now, ""))

    def pending(self, now: float) -> str:
        """Why nothing may be enabled yet at now [s]: an estimator that listens has had no time to answer; or ''."""
        if self.skew.known or self._period == inf:
            return ""
        if 0.0 <= now - self._listens < ANSWERS and not self.skew.pending:
            return "the estimator's clock is not compared yet (no answer): ask again in a second"
        return self.skew.pending

    def _on_answer(self, message: TimeReference) -> None:
        if message.time_ref.sec or message.time_ref.nanosec:
            self.skew.add(seconds(message.time_ref), seconds(message.header.stamp), self._node.now())
        with suppress(ValueError):  # one of somebody else's does not say what it takes off
            self._compare(float(message.source))

    def _compare(self, taken: float) -> None:
        """What the estimator takes off the stamps [s] with what is known here."""
        why = self._clocks.not_taken_off(taken)
        if why and not self.not_taken_off:
            self._node.get_logger().warning(f"force and torque are refused (SP18): {why}")
        self.not_taken_off = why

    def values(self) -> dict[str, object]:
        """For the diagnostics."""
        if not self.skew.known:
            return {"clock_skew_ms": "", "clock_skew_within_ms": ""}
        return {
            "clock_skew_ms": round(1e3 * self.skew.offset, 2),
            "clock_skew_within_ms": round(1e3 * self.skew.within, 2),
        }
