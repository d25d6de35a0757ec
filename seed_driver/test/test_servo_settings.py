# SPDX-License-Identifier: Apache-2.0
"""The servo process with settings of its own: singularities, a TCP, a clean end."""

import math
import os
import time

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.arm.quaternion import inverse, rotate, turned
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import Stage
from seed_driver.process.supervisor import Supervisor
from seed_driver.robot.program import AT_REST
from seed_testing.fault_bench.bench import STEP, FaultBench, leftover_processes
from seed_ur.kinematics import URKinematics
from seed_ur.plant_link import PlantLink
from seed_ur.standin.options import HOME

pytestmark = pytest.mark.realtime

pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")


def test_joints_stay_below_their_limit_at_a_singularity() -> None:
    """Pushing the wrist axis through the axis of joint 4 would need joints of any speed."""
    home = [0.0, -1.6, 1.9, -1.9, -0.12, 0.0]
    with FaultBench("--home", *(str(math.degrees(t)) for t in home), max_joint_speed=0.6) as bench:
        bench.ready()
        bench.robot.ask("reset_stats")
        (x, y, z), q = bench.state.command
        bench.follow(lambda t: ((x, y, z), turned(q, (0.0, 0.0, min(0.5, 0.4 * t)))))
        bench.run(2.5)
        stats = bench.robot.ask("stats")
        assert 0.5 < stats["top_joint_speed"] <= 0.6 * 1.05
        assert bench.robot.ask("state")["safety_mode"] == 1


def test_an_arm_whose_clock_stands_still_for_its_plant_is_waited_for() -> None:
    """Longer than ur_rtde puts up with silence; then it goes on as if nothing had been."""
    with FaultBench("--await-plant", simulated=True) as bench, PlantLink(bench.robot.host) as plant:
        plant.place(URKinematics.for_model("ur5e").forward(HOME), HOME, clock=1000.0)
        clock = [1000.0]

        def run(seconds: float, pace: float) -> None:
            until = time.monotonic() + seconds
            while time.monotonic() < until:
                clock[0] += pace * STEP
                plant.report(np.zeros(3), np.zeros(3), clock[0])
                bench.step()

        while bench.state.stage != Stage.BUSY:
            run(STEP, 0.5)
        run(1.0, 0.0)  # a start that takes long is no hang
        while not bench.state.armed:
            run(0.1, 0.5)
        assert bench.supervisor.deaths == 0
        bench.sway(amplitude=0.05)
        run(0.5, 0.5)
        run(0.1, 0.0)
        before, sent = bench.state, bench.state.sent
        run(3.0, 0.0)
        assert bench.state.armed
        assert bench.state.timestamp == before.timestamp
        assert bench.state.command == before.command
        assert bench.state.sent > sent + 500
        run(0.3, 0.5)
        assert bench.state.armed
        assert bench.state.timestamp > before.timestamp + 0.05


def test_a_tcp_moves_the_robots_pose_not_ours() -> None:
    with FaultBench(tcp=(0.0, 0.01, 0.15, 0.0, 0.0, 0.3)) as bench:
        bench.ready()
        (x, y, z), q = bench.state.command
        robot = bench.robot.ask("state")
        assert np.linalg.norm(np.subtract(robot["tcp_pose"][:3], (x, y, z))) == pytest.approx(
            math.hypot(0.01, 0.15), abs=1e-4
        )
        bench.follow(lambda _: ((x, y, z + 0.02), q))
        bench.run(1.0)
        moved = np.subtract(bench.robot.ask("state")["tcp_pose"][:3], robot["tcp_pose"][:3])
        assert_allclose(moved, (0, 0, 0.02), atol=1e-4)
        assert_allclose(bench.state.sample.p, (x, y, z + 0.02), atol=1e-4)


def test_poses_are_those_of_the_flange_whatever_tcp_another_program_left() -> None:
    """Before our program runs, the TCP is the pendant's."""
    with FaultBench(tcp=(0.0, 0.01, 0.15, 0.0, 0.0, 0.3)) as bench:
        bench.ready()
        flange = bench.state.sample.p
        bench.supervisor.close()
        bench.robot.ask("option", name="remote_control", value=False)
        bench.supervisor = Supervisor(DriverConfig(robot_ip=bench.robot.host))
        bench.supervisor.start(start_program=True)
        bench.wait(lambda s: "local control" in s.reason, 10.0, "local control named")
        assert np.linalg.norm(np.subtract(bench.robot.ask("state")["tcp_pose"][:3], flange)) > 0.1
        assert_allclose(bench.state.sample.p, flange, atol=1e-6)


@pytest.mark.parametrize(("version", "rate"), [("3.15.8", 125), ("5.4.2", 500)])
def test_old_controllers_are_followed_too(version: str, rate: int) -> None:
    """3.15 is a CB3 with its slower cycle; 5.4 does not tell its TCP."""
    with FaultBench("--version", version, tcp=(0.0, 0.01, 0.15, 0.0, 0.0, 0.3)) as bench:
        bench.ready()
        (x, y, z), q = bench.state.command
        bench.robot.ask("reset_stats")
        bench.follow(lambda t: ((x, y, z + 0.02 * min(1.0, t)), q))
        bench.run(2.0)
        period = bench.robot.ask("stats")["servo_period"][
            "p50"
        ]  # a busy computer loses cycles, and is late with others
        assert period == pytest.approx(1.0 / rate, rel=0.1)
        assert_allclose(bench.state.sample.p, (x, y, z + 0.02), atol=1e-4)
        bench.robot.ask("wrench", wrench=[3.0, 0.0, 5.0, 0.0, 0.2, 0.0])  # at the flange's origin, in its axes
        bench.run(0.1)
        told = bench.robot.ask("state")["wrench"]
        assert (abs(np.linalg.norm(told[3:]) - 0.2) < 1e-6) == (version > "5")  # CB3 tells it about the TCP
        torque = rotate(inverse(bench.state.sample.orientation), bench.state.sample.wrench[3:])
        assert_allclose(torque, (0.0, 0.2, 0.0), atol=1e-3)


@pytest.mark.parametrize(("options", "wanted"), [((), 500.0), (("--version", "3.15.8"), 250.0)], ids=["e", "CB3"])
def test_the_node_hears_of_every_cycle_where_poses_are_wanted_so_often(options, wanted: float) -> None:
    """500 Hz, or the 125 Hz of a CB3, which are fewer than the default."""
    with FaultBench(*options, publish_rate=wanted) as bench:
        bench.ready()
        sent, until = set(), time.monotonic() + 0.5
        while time.monotonic() < until:
            sent.add(bench.supervisor.memory.read_state().sent)
            time.sleep(5e-4)
        assert sum(count + 1 in sent for count in sent) > 0.5 * len(sent)


def test_closing_in_freedrive_ends_it_and_the_program() -> None:
    with FaultBench() as bench:
        bench.ready()
        assert bench.ask("freedrive", on=True).ok
        bench.run(0.2)
        start = time.monotonic()
        bench.supervisor.close()
        assert time.monotonic() - start < 1.5  # the process is killed after 2 s
        state = bench.robot.ask("state")
        assert (state["freedrive"], state["runtime_state"], state["messages"]) == (False, 1, [])


def test_closing_leaves_the_robot_at_rest_and_no_process() -> None:
    descriptors, others = len(os.listdir("/proc/self/fd")), leftover_processes(os.getpid())
    with FaultBench() as bench:
        bench.ready()
        bench.sway()
        bench.run(0.4)
        start = time.monotonic()
        bench.supervisor.close()
        assert time.monotonic() - start < 2.5
        assert bench.robot.ask("state")["runtime_state"] == 1
        time.sleep(0.1)
        assert bench.motion(start)[-1, 4] < 1e-3
    assert leftover_processes(os.getpid()) == others
    assert len(os.listdir("/proc/self/fd")) == descriptors


@pytest.mark.parametrize("tcp", [(0.0,) * 6, (0.0, 0.01, 0.15, 0.0, 0.0, 0.3)])
def test_an_arm_that_stands_off_its_target_starts_and_does_not_creep(tcp: tuple[float, ...]) -> None:
    """Friction and load hold the joints off by 0.8 mrad, more than the program lets a resting arm step."""
    with FaultBench(tcp=tcp) as bench:
        bench.ready()
        bench.robot.ask("option", name="servo_error", value=AT_REST + 0.0003)
        bench.run(0.3)
        stood = bench.robot.ask("state")["tcp_pose"]
        for _ in range(3):
            bench.robot.ask("pendant_stop")
            bench.wait(lambda s: not s.armed, 2.0, "report")
            bench.run(0.2)
            bench.recover()
            bench.run(0.3)
        assert_allclose(bench.robot.ask("state")["tcp_pose"], stood, atol=2e-5)
        (x, y, z), q = bench.state.command
        bench.follow(lambda t: ((x, y, z + 0.02 * min(1.0, t)), q))
        bench.run(1.5)
        assert bench.state.armed, bench.state.reason
        assert_allclose(bench.robot.ask("state")["tcp_pose"][2], stood[2] + 0.02, atol=1e-3)
