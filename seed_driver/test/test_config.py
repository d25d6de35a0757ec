# SPDX-License-Identifier: Apache-2.0
"""Settings out of bounds are refused by name, value and bound."""

import pytest

from seed_core.config import to_mapping
from seed_core.errors import SeedError
from seed_driver.config import FIXED, DriverConfig, from_json


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"servo_gain": 50.0}, "servo_gain = 50 must be within 100 and 2000"),
        ({"servo_lookahead": 0.01}, "servo_lookahead = 0.01 s must be within 0.03 and 0.2 s"),
        ({"max_speed": float("nan")}, "max_speed"),
        ({"model": "ur16e"}, "'ur16e' must be one of: ur5e, ur10e"),
        ({"tcp": [0.0, 0.0, 0.1]}, "tcp has 3 values; it needs 6"),
        ({"workspace_low": [0.0, 0.0, 2.0]}, "workspace_low"),
        ({"robot_ip": ""}, "robot_ip is empty"),
        ({"payload_mass": -1.0}, "payload_mass = -1 kg must be within 0 and 50 kg"),
        ({"speed": 1.0}, "unknown key 'speed'"),
        ({"frequency": 3.0}, "frequency = 3 Hz must be 0 or within 50 and 500 Hz"),
        ({"max_jerk": 5.0}, "max_jerk = 5 m/s^3 with max_acceleration = 1 m/s^2 smooths targets over 0.4 s"),
        ({"cpu": 1000}, "cpu = 1000 must be -1 or within 0 and"),
    ],
)
def test_a_bad_setting_is_refused(settings: dict, message: str) -> None:
    with pytest.raises(SeedError) as caught:
        from_json({"robot_ip": "127.0.0.9", **settings}).check()
    assert message in str(caught.value)


def test_settings_survive_the_way_to_the_servo_process() -> None:
    config = DriverConfig(robot_ip="127.0.0.9", tcp=(0.0, 0.0, 0.1, 0.0, 0.0, 0.0), max_speed=0.1)
    assert from_json(to_mapping(config)) == config


def test_limits_of_motion_may_change_while_the_driver_is_configured_and_names_may_not() -> None:
    assert {"robot_ip", "base_frame", "flange_frame", "model", "watchdog_frequency"} < set(FIXED)
    assert not {"max_speed", "workspace_low", "command_timeout", "servo_gain", "tcp", "max_joint_speed"} & set(FIXED)
