# SPDX-License-Identifier: Apache-2.0
"""Runs a node's program with a clock that is off, as on a computer of its own: skewed.py OFFSET PROGRAM [ARGUMENT ...]

No namespace of Linux gives a process another time of day; here the clock of rclpy has an offset [s], which is all that
our nodes read of it.
"""

import runpy
import sys
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration


def skew(offset: float) -> None:
    """From now on, in this process [s]."""
    true_now, ahead = Clock.now, Duration(nanoseconds=round(1e9 * offset))

    def now(clock: Any) -> Any:
        t = true_now(clock)
        return t if clock.clock_type == ClockType.STEADY_TIME else t + ahead

    Clock.now = now


if __name__ == "__main__":
    skew(float(sys.argv[1]))
    sys.argv = sys.argv[2:]
    runpy.run_path(sys.argv[0], run_name="__main__")
