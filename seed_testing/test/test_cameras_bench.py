# SPDX-License-Identifier: Apache-2.0
"""The node of the RealSense cameras as a process, on software devices: a short form of ./seed bench cameras."""

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from seed_core.errors import SeedError
from seed_estimation.realsense import library
from seed_testing.bench.ros import camera_rate

try:
    library()
except SeedError as missing:
    pytest.skip(str(missing), allow_module_level=True)

pytestmark = [pytest.mark.ros, pytest.mark.realtime, pytest.mark.alone]


def test_both_cameras_come_whole_at_30_hz_and_one_that_was_unplugged_returns() -> None:
    figures = camera_rate.run(4.0)
    assert figures["lost_by_the_node"] == 0
    assert figures["rate_hz"] > 29.0
    assert figures["core_share"] < 0.4
    assert figures["return_s"] < 3.0
