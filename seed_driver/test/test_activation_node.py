# SPDX-License-Identifier: Apache-2.0
"""A driver whose servo process cannot be started is not active: it says so and starts nothing later."""

from unittest.mock import Mock

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")

from std_srvs.srv import Trigger

from seed_driver.process.supervisor import Supervisor
from seed_driver.ros.node import DriverNode
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros


def test_a_servo_process_that_cannot_be_started_leaves_the_driver_inactive(monkeypatch) -> None:
    bench = Bench()
    try:
        node = bench.add(DriverNode, robot_ip="127.0.0.9", autostart=False)
        node.trigger_configure()
        monkeypatch.setattr(Supervisor, "start", Mock(side_effect=OSError("no more processes")))
        with pytest.raises(OSError, match="no more processes"):
            node.on_activate(None)
        answer = bench.call(Trigger, "driver/resend_robot_program", Trigger.Request())
        assert (answer.success, answer.message) == (False, "the driver is not active")
        assert node.supervisor is None
    finally:
        bench.close()
