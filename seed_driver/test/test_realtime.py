# SPDX-License-Identifier: Apache-2.0
"""Scheduling is changed where it is meant to be, and nowhere else."""

import json
import os
import resource
import subprocess
import sys

import pytest

from seed_driver.config import DriverConfig
from seed_driver.process.realtime import take_priority, threads_above
from seed_ur.standin_client import StandIn

PRIORITIES = """
import os, sys
from seed_driver.config import DriverConfig
from seed_driver.robot.connection import Robot

robot = Robot(DriverConfig(robot_ip=sys.argv[1]))
robot.start_program()
print(sorted(os.sched_getparam(int(thread)).sched_priority for thread in os.listdir("/proc/self/task")))
os._exit(0)
"""


def test_the_priority_of_new_threads_is_not_kept_by_the_one_that_makes_them() -> None:
    def scheduling():
        return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)

    before = scheduling()
    with threads_above(DriverConfig(robot_ip="127.0.0.1", realtime_priority=5, cpu=0)):
        pass
    assert scheduling() == before


@pytest.mark.parametrize(("limit", "ours"), [(99, 60), (61, 60), (60, 59), (40, 39)])
def test_threads_of_ur_rtde_are_above_ours_whatever_a_user_may_have_at_most(monkeypatch, limit: int, ours: int) -> None:
    """A thread that spins at the priority of the one that it waits for keeps it from a processor that both share."""
    now = [(os.SCHED_OTHER, 0)]

    def take(_: int, policy: int, wanted: os.sched_param) -> None:
        if wanted.sched_priority > max(now[-1][1], limit):  # man 7 sched, "Privileges and resource limits"
            raise PermissionError
        now.append((policy, wanted.sched_priority))

    monkeypatch.setattr(os, "sched_setscheduler", take)
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: now[-1][0])
    monkeypatch.setattr(os, "sched_getparam", lambda _: os.sched_param(now[-1][1]))
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    take_priority(60)
    assert now[-1] == (os.SCHED_FIFO, ours)
    with threads_above(DriverConfig(robot_ip="127.0.0.1", realtime_priority=60)):
        assert now[-1] == (os.SCHED_FIFO, ours + 1)
    assert now[-1] == (os.SCHED_FIFO, ours)


@pytest.mark.realtime
def test_ur_rtde_gives_no_thread_a_priority_of_its_own_on_a_real_time_kernel() -> None:
    if subprocess.run(["unshare", "--mount", "true"], capture_output=True).returncode:
        pytest.skip("only root can show ur_rtde a real-time kernel")
    show = 'mount -t tmpfs none /sys/kernel && echo 1 > /sys/kernel/realtime && exec "$@"'
    with StandIn() as robot:
        shown = ["unshare", "--mount", "sh", "-c", show, "sh", sys.executable, "-c", PRIORITIES, robot.host]
        done = subprocess.run(shown, capture_output=True, text=True, timeout=60.0)
    priorities = done.stdout.splitlines()[-1]
    assert len(json.loads(priorities)) > 1, done.stderr  # its thread is there
    assert set(json.loads(priorities)) == {0}
