# SPDX-License-Identifier: Apache-2.0
"""The watchdog needs no ROS: whoever gives the targets is frozen or killed, and the arm comes to rest by itself."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from seed_testing.fault_bench.bench import AT_REST, leftover_processes
from seed_ur.standin_client import StandIn, private_host

pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")
pytestmark = pytest.mark.realtime
REST_WITHIN = 0.35  # [s]: command_timeout or the robot's watchdog 0.1, braking from 0.12 m/s at 1 m/s^2
PATIENCE = 0.4  # [s] that a busy test machine may pause
FARTHEST = 0.03  # [m] on the way to rest
STEERING = """
import sys
from types import SimpleNamespace
from seed_testing.fault_bench.bench import FaultBench

with FaultBench(robot=SimpleNamespace(host=sys.argv[1])) as bench:
    bench.ready()
    bench.sway(0.04, 3.0)
    print("rclpy" in sys.modules, flush=True)
    bench.run(60.0)
"""


@pytest.fixture
def robot() -> Iterator[StandIn]:
    robot = StandIn(private_host())
    yield robot
    robot.close()


@pytest.mark.parametrize("fault", [signal.SIGSTOP, signal.SIGKILL])
def test_an_arm_rests_when_the_process_that_steers_it_is_frozen_or_killed(
    robot: StandIn, fault: signal.Signals
) -> None:
    command = [sys.executable, "-c", STEERING, robot.host]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as steering:
        try:
            assert steering.stdout is not None
            assert steering.stdout.readline() == "False\n"
            time.sleep(0.5)
            start = time.monotonic()
            os.kill(steering.pid, fault)
            time.sleep(REST_WITHIN + PATIENCE + 0.5)
            rows = [row for row in robot.ask("motion", since=start)["motion"] if row[0] >= start]
            assert max(row[4] for row in rows[:5]) > 10.0 * AT_REST  # it was on its way
            assert all(row[4] < AT_REST for row in rows if row[0] > start + REST_WITHIN + PATIENCE)
            assert math.dist(rows[0][1:4], rows[-1][1:4]) < FARTHEST
            if fault == signal.SIGSTOP:
                os.kill(steering.pid, signal.SIGCONT)
                time.sleep(0.6)
                place = robot.ask("state")["tcp_pose"][:3]
                assert math.dist(place, rows[-1][1:4]) < 1e-3  # targets alone do not start it again
            else:
                assert leftover_processes(steering.pid) == []
        finally:
            steering.kill()
