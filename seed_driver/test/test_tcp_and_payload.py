# SPDX-License-Identifier: Apache-2.0
"""TCP and payload of the robot: left alone where they are not configured, compared, and a change moves nothing."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.arm.quaternion import IDENTITY, inverse, rotate
from seed_core.config import ConfigError
from seed_driver.config import DriverConfig
from seed_driver.robot.connection import SLIDER, Robot
from seed_driver.robot.link import LinkError
from seed_driver.robot.rtde_client import RtdeClient
from seed_driver.robot.tcp_and_payload import OUTPUTS, TcpAndPayload, difference, require, wanted
from seed_testing.fault_bench.bench import FaultBench
from seed_ur import rtde
from seed_ur.kinematics import URKinematics
from seed_ur.standin_client import StandIn

TCP = (0.0, 0.0, 0.15, 0.0, 0.0, 0.0)
LONGER = (0.0, 0.0, 0.20, 0.0, 0.0, 0.0)
realtime = pytest.mark.realtime


@pytest.fixture(scope="module")
def robot():
    pytest.importorskip("rtde_control", reason="ur_rtde is not installed (pip install ur-rtde==1.6.5)")
    with StandIn() as made:
        yield made


@pytest.fixture
def loaded(robot):
    robot.ask("pendant_stop")
    robot.ask("tool", tcp=TCP, payload=2.5, cog=[0.01, 0.0, 0.04])
    return robot


def flange(robot: StandIn) -> np.ndarray:
    return URKinematics.for_model("ur5e").forward(robot.ask("state")["q"])[:3, 3]


@realtime
def test_what_is_not_configured_stays_as_it_is_on_the_robot_and_targets_are_the_flanges(loaded) -> None:
    with FaultBench(robot=loaded) as bench:
        bench.ready()
        (x, y, z), q = bench.state.command
        bench.follow(lambda t: ((x, y, z + min(0.01, 0.05 * t)), q))
        bench.run(0.8)
        state = loaded.ask("state")
        assert (state["payload"], state["payload_cog"]) == (2.5, [0.01, 0.0, 0.04])
        assert_allclose(state["tcp_offset"], TCP, atol=1e-12)
        loaded.ask("wrench", wrench=[3.0, 0.0, 5.0, 0.0, 0.2, 0.0])  # at the flange's origin, in its axes
        bench.run(0.1)
        torque = rotate(inverse(bench.state.sample.orientation), bench.state.sample.wrench[3:])
        loaded.ask("wrench", wrench=[0.0] * 6)
        assert_allclose(torque, (0.0, 0.2, 0.0), atol=1e-3)
        assert_allclose(flange(loaded), (x, y, z + 0.01), atol=2e-4)


@realtime
@pytest.mark.parametrize("moving", [False, True], ids=["standing", "moving"])
def test_a_tcp_that_changes_moves_nothing_and_is_named(loaded, moving: bool) -> None:
    with FaultBench(robot=loaded) as bench:
        bench.ready()
        if moving:
            bench.sway()
            bench.run(0.7)
        loaded.ask("reset_stats")
        before = flange(loaded)
        loaded.ask("tool", tcp=LONGER)
        bench.wait(lambda s: not s.armed, 0.5, "report")
        bench.still()
        bench.run(0.4)
        assert "TCP is [0, 0, 0.2, 0, 0, 0] m, rad, not [0, 0, 0.15, 0, 0, 0] m, rad as before" in bench.state.reason
        assert np.linalg.norm(flange(loaded) - before) < (5e-3 if moving else 1e-3)
        assert loaded.ask("stats")["top_joint_speed"] < 0.15  # [rad/s]
        bench.recover_in_place()
        (x, y, z), q = bench.state.command
        bench.follow(lambda t: ((x, y, z + min(0.01, 0.05 * t)), q))
        bench.run(0.8)
        assert bench.state.reason == ""
        assert_allclose(flange(loaded), (x, y, z + 0.01), atol=2e-4)


@realtime
def test_a_tcp_that_changes_behind_a_slow_network_moves_the_arm_no_further_than_it_brakes(loaded) -> None:
    """Targets for the TCP before are on their way then, and those that are made until its change is seen."""
    longer = (0.0, 0.0, 0.18, 0.0, 0.0, 0.0)  # by so little that the check of a step lets it pass
    with FaultBench(robot=loaded) as bench:
        bench.ready()
        (x, y, z), q = bench.state.command
        bench.follow(lambda t: ((x, y, z + 0.1 * t - 0.1 * 0.25 * (1.0 - np.exp(-t / 0.25))), q))
        loaded.ask("slow", seconds=0.02)
        try:
            bench.run(1.0)
            since, before = time.monotonic(), flange(loaded)
            loaded.ask("tool", tcp=longer)
            bench.wait(lambda s: not s.armed, 0.5, "report")
            bench.still()
            bench.run(0.4)
        finally:
            loaded.ask("slow", seconds=0.0)
        assert "TCP is [0, 0, 0.18, 0, 0, 0] m, rad, not [0, 0, 0.15, 0, 0, 0] m, rad as before" in bench.state.reason
        assert loaded.ask("state")["runtime_state"] == 1
        way = flange(loaded) - before
        assert np.linalg.norm(way) < 5e-3
        assert way[2] > 0.0  # on its way, not back by the difference
        assert bench.motion(since + 0.01)[:, 4].max() < 0.15
        bench.recover_in_place()


@realtime
def test_a_payload_that_changes_is_a_hold_and_a_request_sends_what_is_configured(loaded) -> None:
    inertia = (0.01, 0.02, 0.03, 0.0, 0.0, 0.001)
    with FaultBench(robot=loaded, payload_mass=1.25, payload_cog=(0.0, 0.0, 0.05), payload_inertia=inertia) as bench:
        bench.ready()
        assert_allclose(loaded.ask("state")["payload_inertia"], inertia)
        loaded.ask("tool", payload=0.0)
        bench.wait(lambda s: not s.armed, 0.5, "report")
        assert "the robot's payload is 0 kg, not 1.25 kg as before" in bench.state.reason
        assert bench.ask("start").ok
        bench.run(0.3)
        assert loaded.ask("state")["payload"] == 1.25
        assert bench.state.armed


@realtime
@pytest.mark.parametrize("program", ["checked", "ur_rtde"])
def test_a_payload_that_is_shown_late_is_no_jump(loaded, program: str) -> None:
    """Nothing is sent until then: the way that the path goes meanwhile must not come in one step."""
    with FaultBench(robot=loaded, robot_program=program, payload_mass=0.5, max_speed=0.25) as bench:
        bench.ready()
        (x, y, z), q = bench.state.command
        bench.follow(lambda t: ((x, y, z + 0.1 * t - 0.1 * 0.25 * (1.0 - np.exp(-t / 0.25))), q))
        bench.run(0.6)
        loaded.ask("corrupt", name="payload", value=0.5)
        try:
            since = time.monotonic()
            bench.supervisor.set_config(replace(bench.supervisor.config, payload_mass=1.25))
            bench.run(0.2)
        finally:
            loaded.ask("corrupt", name="payload")
        bench.run(0.3)
        assert bench.motion(since)[:, 4].max() < 0.25
        assert bench.state.reason == ""


@realtime
@pytest.mark.parametrize("inertia", [(0.0,) * 6, (0.01, 0.02, 0.03, 0.0, 0.0, 0.001)], ids=["mass", "inertia"])
@pytest.mark.parametrize("program", ["checked", "ur_rtde"])
def test_a_payload_with_its_centre_of_mass_at_the_flange_takes_the_place_of_the_robots(
    loaded, program: str, inertia
) -> None:
    """ur_rtde's own script keeps the robot's where it is sent [0, 0, 0]."""
    with FaultBench(robot=loaded, robot_program=program, payload_mass=1.25, payload_inertia=inertia) as bench:
        bench.ready()
        state = loaded.ask("state")
        assert state["payload"] == 1.25
        assert_allclose(state["payload_cog"], 0.0, atol=1e-5)


@realtime
def test_a_payload_that_the_robot_does_not_take_is_named_and_the_process_lives(loaded) -> None:
    with FaultBench(robot=loaded, payload_mass=0.5) as bench:
        bench.ready()
        loaded.ask("corrupt", name="payload", value=0.5)
        try:
            bench.supervisor.set_config(replace(bench.supervisor.config, payload_mass=1.25))
            bench.wait(lambda s: not s.armed, 3.0, "hold")
            assert "the robot's payload is 0.5 kg, not 1.25 kg as before" in bench.state.reason
            deaths = bench.supervisor.deaths
            reply = bench.ask("start")
            assert not reply.ok
            assert "the robot's payload is 0.5 kg, not 1.25 kg as configured" in reply.text
            assert bench.supervisor.deaths == deaths
        finally:
            loaded.ask("corrupt", name="payload")
        bench.recover()


@realtime
@pytest.mark.parametrize("delay", [0.0, 0.05], ids=["shown-at-once", "shown-later"])
def test_the_first_servo_command_after_a_change_of_the_tcp_is_a_pose_of_the_new_one(loaded, delay: float) -> None:
    """In the same cycle already: a pose for the old one would be a jump by the difference."""
    sent = []
    robot = Robot(DriverConfig(robot_ip=loaded.host, tcp=TCP))
    with robot.states:
        robot.control = SimpleNamespace(
            setTcp=lambda tcp: loaded.ask("tool", tcp=tcp) is not None,
            servoL=lambda pose, *_: sent.append(pose),
            kickWatchdog=lambda: None,
        )
        robot.apply_tool(robot.config)  # as at the start
        robot.sample()
        robot.servo((0.4, 0.0, 0.3), IDENTITY, 0.002)
        assert_allclose(sent.pop()[:3], (0.4, 0.0, 0.45))
        loaded.ask("pause_outputs", seconds=delay)
        robot.apply_tool(replace(robot.config, tcp=LONGER))
        until = time.monotonic() + 0.9
        while not sent and time.monotonic() < until:
            robot.servo((0.4, 0.0, 0.3), IDENTITY, 0.002)
            robot.states.poll()
            robot.sample()
            robot.tool_changed()
        assert_allclose(sent[0][:3], (0.4, 0.0, 0.5))


@realtime
@pytest.mark.parametrize("version", ["5.10.0", "3.15.8"])
def test_a_setting_that_is_refused_while_the_program_runs_is_a_hold_until_the_robot_takes_what_is_configured(
    version: str,
) -> None:
    with FaultBench("--version", version) as bench:
        bench.ready()
        possible = bench.supervisor.config
        bench.supervisor.set_config(replace(possible, payload_inertia=(0.01, 0.02, 0.03, 0.0, 0.0, 0.001)))
        bench.wait(lambda s: not s.armed, 2.0, "hold")
        why = "payload_inertia needs PolyScope 5.11 or later: set it to zero"
        assert bench.state.reason == f"{why}; then call resend_robot_program"
        assert bench.ask("start").text == why
        assert not bench.state.armed
        bench.supervisor.set_config(possible)
        bench.run(0.2)
        assert not bench.state.armed
        bench.recover()


@realtime
def test_a_start_that_is_refused_leaves_no_program_playing_and_the_next_one_is_as_any() -> None:
    with FaultBench("--version", "5.10.0", payload_inertia=(0.01, 0.02, 0.03, 0.0, 0.0, 0.001)) as bench:
        bench.wait(lambda s: "payload_inertia needs PolyScope 5.11" in s.reason, 10.0, "refusal")
        bench.run(0.1)
        state = bench.robot.ask("state")
        assert (state["runtime_state"], state["program"]) == (1, None)
        for _ in range(2):
            assert bench.ask("start").text == "payload_inertia needs PolyScope 5.11 or later: set it to zero"
        bench.supervisor.set_config(replace(bench.supervisor.config, payload_inertia=(0.0,) * 6))
        bench.run(0.1)
        bench.recover()


@realtime
def test_a_speed_slider_that_another_client_holds_is_named_and_set_once_it_is_free(loaded) -> None:
    other = RtdeClient(loaded.host)
    assert other.take_inputs(*SLIDER.names)
    with FaultBench(robot=loaded, speed_slider=0.25) as bench:
        with other:
            bench.wait(lambda s: "another RTDE client holds the speed slider" in s.reason, 10.0, "refusal")
            assert not bench.ask("start").ok
            assert not bench.state.armed
        bench.recover()
        assert loaded.ask("state")["speed_slider"] == pytest.approx(0.25)
    loaded.ask("option", name="speed_slider", value=1.0)


@realtime
def test_a_connection_for_the_speed_slider_that_the_controller_has_closed_is_opened_again(loaded) -> None:
    robot = Robot(DriverConfig(robot_ip=loaded.host))
    with robot.states:
        robot._set_slider(0.25)
        while loaded.ask("state")["speed_slider"] != pytest.approx(0.25):
            time.sleep(0.01)
        loaded.ask("drop_rtde")
        time.sleep(0.05)
        try:
            for fraction in (0.5, 0.75):  # the second by the connection that was opened again
                robot._set_slider(fraction)
                time.sleep(0.05)
                assert loaded.ask("state")["speed_slider"] == pytest.approx(fraction)
        finally:
            robot._slider.close()
            loaded.ask("option", name="speed_slider", value=1.0)


@realtime
def test_a_release_that_tells_less_of_its_payload_than_it_is_believed_to_is_followed_without_it(monkeypatch) -> None:
    earlier = dict.fromkeys(("payload", "payload_cog"), ((3, 10), (5, 4)))
    monkeypatch.setattr(rtde, "_SINCE", {**rtde._SINCE, **earlier})  # here; the controller's process has UR's table
    with StandIn(None, "--version", "5.4.0") as old:
        robot = Robot(DriverConfig(robot_ip=old.host))
        with robot.states:
            assert not robot.states.values.keys() & set(OUTPUTS)
            assert len(robot.sample().q) == 6


def test_the_difference_names_the_first_quantity_that_differs_beyond_its_tolerance() -> None:
    here = TcpAndPayload(TCP, (2.5,), (0.01, 0.0, 0.04))
    assert difference(here, here._replace(mass=(2.5004,), tcp=(0.0, 0.0, 0.1501, 0.0, 0.0, 0.0))) == ""
    assert difference(here, TcpAndPayload()) == ""  # of an old controller
    assert difference(here, here._replace(mass=(0.0,))) == "payload is 0 kg, not 2.5 kg"
    half_a_turn, same = (0.0, 0.0, 0.1, 0.0, 0.0, np.pi), (0.0, 0.0, 0.1, 0.0, 0.0, -np.pi)
    assert difference(TcpAndPayload(half_a_turn), TcpAndPayload(same)) == ""
    with pytest.raises(LinkError, match=r"payload is 0 kg, not 1\.2 kg as configured: it has not taken it"):
        require(TcpAndPayload(mass=(1.2,)), TcpAndPayload(mass=(0.0,)))


def test_a_payload_that_is_not_configured_is_not_wanted() -> None:
    assert wanted(DriverConfig(robot_ip="127.0.0.1")) == TcpAndPayload()
    with pytest.raises(ConfigError, match="payload_mass"):
        DriverConfig(robot_ip="127.0.0.1", payload_mass=-1.0).check()
