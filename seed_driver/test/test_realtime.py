# SPDX-License-Identifier: Apache-2.0
"""Scheduling is changed where it is meant to be, and nowhere else."""

import os

from seed_driver.config import DriverConfig
from seed_driver.process.realtime import threads_above


def test_the_priority_of_new_threads_is_not_kept_by_the_one_that_makes_them() -> None:
    def scheduling():
        return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)

    before = scheduling()
    with threads_above(DriverConfig(robot_ip="127.0.0.1", realtime_priority=5, cpu=0)):
        pass
    assert scheduling() == before
