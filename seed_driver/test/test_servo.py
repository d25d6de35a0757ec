# SPDX-License-Identifier: Apache-2.0
"""The servo process against the stand-in: it follows, it keeps its limits at the robot, it closes cleanly."""

import math
import time

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.arm.quaternion import to_pose, turned
from seed_testing.fault_bench.bench import FaultBench
from seed_ur.pose import pose_from_matrix

pytestmark = pytest.mark.realtime

pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")


@pytest.fixture(scope="module")
def bench():
    with FaultBench() as made:
        made.ready()
        yield made


@pytest.fixture(autouse=True)
def afresh(bench):
    """Every test starts with a running program, at rest, statistics forgotten."""
    bench.still()
    bench.run(0.3)
    if not bench.state.armed:
        bench.recover()
    bench.robot.ask("reset_stats")


def test_the_arm_follows_a_target_to_a_tenth_of_a_millimetre(bench) -> None:
    (x, y, z), q = bench.state.command
    goal = (x + 0.01, y - 0.02, z + 0.01), turned(q, (0.02, -0.05, 0.03))
    bench.follow(lambda _: goal)
    bench.run(1.5)
    pose = bench.robot.ask("state")["tcp_pose"]
    assert_allclose(pose[:3], goal[0], atol=1e-4)
    assert_allclose(pose, pose_from_matrix(to_pose(*goal)), atol=1e-3)
    assert_allclose(bench.state.sample.p, pose[:3], atol=1e-4)


@pytest.mark.parametrize("jump", ["1 m", "90 degrees"])
def test_no_jump_of_the_target_makes_the_robot_faster_than_the_limit(bench, jump: str) -> None:
    """Past the target checks of the node: the servo process alone has to hold the limit, measured at the robot."""
    (x, y, z), q = bench.state.command
    goal = ((x, y + 1.0, z), q) if jump == "1 m" else ((x, y, z), turned(q, (0.0, 0.0, math.pi / 2)))
    sent, start = bench.state.sent, time.monotonic()
    bench.follow(lambda _: goal)
    bench.run(1.0)
    kept = (bench.state.sent - sent) / (500.0 * (time.monotonic() - start))  # share of the cycles; none is made up for
    bench.still()
    bench.run(0.4)
    stats, config = bench.robot.ask("stats"), bench.supervisor.config
    assert stats["top_speed"] <= config.max_speed * 1.02
    assert stats["top_turning"] <= config.max_angular_speed * 1.02
    assert max(stats["top_speed"] / config.max_speed, stats["top_turning"] / config.max_angular_speed) > 0.9 * kept
    assert bench.robot.ask("state")["safety_mode"] == 1


def test_silence_of_the_target_stops_the_arm_and_only_a_request_moves_it_again(bench) -> None:
    bench.sway()
    bench.run(0.7)
    start = time.monotonic()
    bench.still()
    bench.wait(lambda s: not s.armed, 1.0, "hold")
    bench.run(0.5)
    assert "no target_frame for 0.1 s" in bench.state.reason
    motion = bench.motion(start)
    assert motion[-1, 4] < 1e-4
    bench.sway()
    bench.run(0.4)
    assert not bench.state.armed
    assert bench.robot.ask("state")["tcp_pose"][:3] == pytest.approx(motion[-1, 1:4].tolist(), abs=1e-5)
    assert bench.ask("start").ok
    bench.run(0.5)
    assert np.linalg.norm(bench.motion(start)[-1, 1:4] - motion[-1, 1:4]) > 1e-3


def test_stop_decelerates_within_the_limit(bench) -> None:
    (x, y, z), q = bench.state.command
    bench.follow(lambda t: ((x, y, z + 0.1 * t), q))
    bench.run(0.8)
    start = time.monotonic()
    assert bench.ask("stop").ok
    bench.still()
    bench.run(0.5)
    motion = bench.motion(start)
    assert motion[0, 4] > 0.05
    assert motion[-1, 4] < 1e-4
    assert np.linalg.norm(motion[-1, 1:4] - motion[0, 1:4]) < 0.1**2 / 2 + 0.1 * 0.1  # braking, and 0.1 s of lag
    assert bench.state.reason == "stopped on request"


def test_out_of_reach_on_the_way_stops_with_the_reason(bench) -> None:
    (x, y, z), q = bench.state.command
    bench.supervisor.set_config(
        bench.supervisor.config.__class__(**{**bench.supervisor.config.__dict__, "max_joint_speed": 3.0})
    )
    bench.follow(lambda _: ((x - 0.9, y, z), q))
    bench.wait(lambda s: not s.armed, 15.0, "stop at the end of the reach")
    assert "out of reach of the ur5e" in bench.state.reason
    bench.still()
    assert bench.robot.ask("state")["runtime_state"] == 2  # the robot's own program has not failed
    bench.recover()
    bench.follow(lambda _: ((x, y, z), q))
    bench.run(8.0 if bench.state.sample.p[0] < x - 0.5 else 4.0)
    assert_allclose(bench.state.sample.p, (x, y, z), atol=2e-3)


def test_payload_and_slider_reach_the_controller(bench) -> None:
    settings = {**bench.supervisor.config.__dict__, "payload_mass": 1.25, "speed_slider": 0.5}
    bench.supervisor.set_config(bench.supervisor.config.__class__(**settings))
    bench.run(0.4)
    state = bench.robot.ask("state")
    assert state["payload"] == pytest.approx(1.25)
    assert state["speed_slider"] == pytest.approx(0.5)
    bench.supervisor.set_config(bench.supervisor.config.__class__(**{**settings, "speed_slider": 1.0}))
    bench.run(0.3)


def test_freedrive_and_back_without_a_jump(bench) -> None:
    assert bench.ask("freedrive", on=True).ok
    bench.run(0.3)
    assert bench.robot.ask("state")["freedrive"] is True
    assert not bench.ask("start").ok
    before = bench.robot.ask("state")["tcp_pose"]
    assert bench.ask("freedrive", on=False).ok
    bench.run(0.3)
    after = bench.robot.ask("state")
    assert after["freedrive"] is False
    assert_allclose(after["tcp_pose"], before, atol=1e-4)
    assert bench.ask("start").ok


def test_stop_ends_freedrive(bench) -> None:
    assert bench.ask("freedrive", on=True).ok
    bench.run(0.2)
    assert bench.ask("stop").ok
    assert bench.robot.ask("state")["freedrive"] is False
    bench.run(0.1)
    assert bench.state.reason == "stopped on request"
    assert bench.ask("start").ok


def test_zeroing_is_refused_while_moving_and_done_at_rest(bench) -> None:
    bench.robot.ask("wrench", wrench=[0, 0, 5, 0, 0, 0])
    bench.sway()
    bench.run(0.5)
    reply = bench.ask("zero_ft")
    assert not reply.ok
    assert "moving" in reply.text
    bench.still()
    bench.wait(lambda s: not s.armed, 1.0, "hold")
    bench.run(0.4)
    assert max(map(abs, bench.state.sample.wrench)) > 4.9
    assert bench.ask("zero_ft").ok
    bench.run(0.1)
    assert max(map(abs, bench.state.sample.wrench)) < 0.01
    bench.robot.ask("wrench", wrench=[0.0] * 6)
