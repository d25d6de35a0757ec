# SPDX-License-Identifier: Apache-2.0
"""A driver before it is active: what may be set then, and a servo process that cannot be started."""

import subprocess
from unittest.mock import Mock

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from seed_driver.ros.node import DriverNode
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros


def test_a_servo_process_that_cannot_be_started_leaves_the_driver_inactive(monkeypatch) -> None:
    bench = Bench()
    try:
        node = bench.add(DriverNode, robot_ip="127.0.0.9", autostart=False)
        node.trigger_configure()
        monkeypatch.setattr(subprocess, "Popen", Mock(side_effect=OSError("no more processes")))
        with pytest.raises(OSError, match="no more processes"):
            node.on_activate(None)
        answer = bench.call(Trigger, "driver/resend_robot_program", Trigger.Request())
        assert (answer.success, answer.message) == (False, "the driver is not active")
        assert node.supervisor is None
    finally:
        bench.close()


def test_an_activation_that_failed_leaves_the_driver_as_before_it_was_configured(monkeypatch) -> None:
    bench = Bench()
    try:
        node = bench.add(DriverNode, robot_ip="127.0.0.9", autostart=False)
        before = len(list(node.publishers))
        node.trigger_configure()
        configured = len(list(node.publishers))
        monkeypatch.setattr(subprocess, "Popen", Mock(side_effect=OSError("no more processes")))
        assert node.trigger_activate() == TransitionCallbackReturn.ERROR
        assert len(list(node.publishers)) == before
        (result,) = node.set_parameters([Parameter("model", value="ur10e")])
        assert result.successful, result.reason
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert len(list(node.publishers)) == configured
    finally:
        bench.close()


def test_a_priority_that_the_loop_has_taken_cannot_be_set() -> None:
    """Not while the driver is unconfigured either, when everything else can be."""
    bench = Bench()
    try:
        node = bench.add(DriverNode, robot_ip="127.0.0.9", autostart=False)
        for name, value, may in (("loop_priority", 1, False), ("publish_rate", 99.0, True)):
            (result,) = node.set_parameters([Parameter(name, value=value)])
            assert result.successful is may
    finally:
        bench.close()


def test_values_out_of_bounds_and_deletions_are_refused_before_it_is_configured() -> None:
    bench = Bench()
    try:
        node = bench.add(DriverNode, robot_ip="127.0.0.9", autostart=False)
        (result,) = node.set_parameters([Parameter("max_speed", value=99.0)])
        assert "max_speed = 99 m/s must be within" in result.reason
        (result,) = node.set_parameters([Parameter("max_speed")])  # as `ros2 param delete` does
        assert "max_speed = None must be a number" in result.reason
        (result,) = node.set_parameters([Parameter("workspace_low", value=[0.0, 0.0, 1.9])])
        assert result.successful  # workspace_high may come next
    finally:
        bench.close()


def test_a_driver_that_does_nothing_says_why_on_diagnostics() -> None:
    bench, told = Bench(), []
    try:
        node = bench.add(DriverNode, robot_ip="", autostart=False)
        bench.client.create_subscription(DiagnosticArray, "/diagnostics", lambda m: told.append(m.status[0]), 10)
        assert bench.until(lambda: any(s.message.startswith("not configured: configure") for s in told))
        node.trigger_configure()
        assert bench.until(lambda: any("robot_ip is empty" in s.message for s in told))
        assert told[-1].level == DiagnosticStatus.ERROR
        node.set_parameters([Parameter("robot_ip", value="127.0.0.9")])
        node.trigger_configure()
        assert bench.until(lambda: told[-1].message == "inactive: activate the node")
        assert {s.name for s in told} == {"driver: robot link"}
    finally:
        bench.close()
