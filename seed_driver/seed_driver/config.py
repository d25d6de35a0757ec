# SPDX-License-Identifier: Apache-2.0
"""Every setting of the driver, with unit, bounds and meaning; the node declares its parameters from here."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from seed_core.arm.limits import MotionLimits
from seed_core.config import ConfigError, checked, field, from_mapping, inherited
from seed_core.vector3 import Vector3
from seed_driver.clearance_settings import ClearanceSettings, Vector6
from seed_ur.models import MODELS

SLOWEST = 50.0  # [Hz] of servo rates: a robot that is heard less often than every 60 ms counts as lost


@dataclass(frozen=True)
class DriverConfig(ClearanceSettings):
    """Settings, with the limits of motion and targets; `check` refuses what is out of bounds."""

    # fixed
    loop_priority: int = field(
        50, low=0, high=98, doc="SCHED_FIFO priority of the node's loop if allowed, below the servo process's; 0: none"
    )

    # fixed while the driver is configured
    robot_ip: str = field("", doc="address of the controller; must be set")
    model: str = field("ur5e", choices=tuple(MODELS), doc="arm")
    calibration_file: str = field("", doc="kinematics YAML written by ur_calibration; empty: published lengths")
    frequency: float = field(0.0, unit="Hz", low=0, high=500, doc="servo rate, 50 or more; 0: 500, or 125 on CB3")
    flange_frame: str = field("tool0", doc="name of the flange frame")
    joint_prefix: str = field("", doc="put before the name of every joint")
    publish_rate: float = field(
        250.0, unit="Hz", low=10, high=500, doc="of current_pose, at most the servo rate; others at a half or quarter"
    )
    publish_tf: bool = field(True, doc="publish base to flange on /tf; off where robot_state_publisher does")
    realtime_priority: int = field(
        60, low=0, high=98, doc="SCHED_FIFO priority of the servo process if allowed; 0: none"
    )
    cpu: int = field(-1, low=-1, high=1023, doc="processor for the servo process; -1: any")
    simulated: bool = field(
        False, doc="the controller is a simulation whose clock shows ROS time and may run slower than the wall's"
    )
    registers: str = field(
        "auto",
        choices=("auto", "upper", "lower"),
        doc="RTDE input registers to use: 24 to 47, which UR keeps for external clients, or 0 to 23, which it gives to "
        "fieldbus and PLC; auto: the upper ones where ur_rtde can",
    )
    robot_program: str = field(
        "checked",
        choices=("checked", "ur_rtde"),
        doc="what runs on the robot: the driver's program, which checks every step, or ur_rtde's own, which does not",
    )
    watchdog_frequency: float = field(10.0, unit="Hz", low=1, high=100, doc="below it the robot stops by itself")

    # changed at any time
    max_speed: float = inherited(MotionLimits, "max_speed", 0.25, high=1.0)  # typical of a UR, by its data sheets
    servo_gain: float = field(2000.0, low=100, high=2000, doc="gain of servoj; less is softer and lags more")
    servo_lookahead: float = field(0.03, unit="s", low=0.03, high=0.2, doc="lookahead time of servoj")
    max_joint_speed: float = field(1.0, unit="rad/s", low=0.01, high=6.3, doc="of any joint, below the arm's own limit")
    max_tracking_error: float = field(
        0.03, unit="m", low=1e-3, high=0.5, doc="an arm further from its command is held; several times the usual lag"
    )
    max_angular_tracking_error: float = field(
        0.15, unit="rad", low=1e-2, high=3.0, doc="an arm turned further from its command is held"
    )
    payload_mass: float = field(
        0.0,
        unit="kg",
        low=0,
        high=50,
        doc="gripper and tool, for the controller; 0: mass and centre as set on the robot",
    )
    payload_cog: Vector3 = field(
        (0.0, 0.0, 0.0), unit="m", low=-1, high=1, doc="their centre of mass in the flange frame"
    )
    payload_inertia: Vector6 = field(
        (0.0,) * 6,
        unit="kg m^2",
        low=-10,
        high=133,
        doc="about that centre: xx, yy, zz, xy, xz, yz; zero: as the robot has it. PolyScope 5.11 and later",
    )
    tcp: Vector6 = field(
        (0.0,) * 6, unit="m, rad", low=-4, high=4, doc="TCP in the flange frame as a pose vector; zero: as on the robot"
    )
    tool_voltage: int = field(24, unit="V", low=12, high=24, doc="of set_tool_power at the tool's connector: 12 or 24")
    speed_slider: float = field(0.0, low=0, high=1, doc="speed slider of the pendant; 0: as it is there")

    def check(self) -> DriverConfig:
        """Itself, or ConfigError naming the setting, its value, unit and bounds."""
        if not self.robot_ip:
            raise ConfigError("robot_ip is empty: give the controller's address, e.g. robot_ip:=192.168.56.101")
        if 0.0 < self.frequency < SLOWEST:
            raise ConfigError(f"frequency = {self.frequency:g} Hz must be 0 or within {SLOWEST:g} and 500 Hz")
        if self.tool_voltage not in (12, 24):
            raise ConfigError(f"tool_voltage = {self.tool_voltage} V must be 12 or 24 V")
        if self.cpu >= (count := os.cpu_count() or 1):
            raise ConfigError(f"cpu = {self.cpu} must be -1 or within 0 and {count - 1}: there are {count} processors")
        return checked(self, "driver")


_NAMES = tuple(DriverConfig.__dataclass_fields__)
FIXED = (  # while the driver is configured
    "base_frame",
    "hand_file",
    "surroundings_file",
    *_NAMES[_NAMES.index("robot_ip") : _NAMES.index("servo_gain")],
)
# What the robot's own controller has to be told
TOLD_TO_CONTROLLER = ("payload_mass", "payload_cog", "payload_inertia", "tcp", "speed_slider")


def from_json(data: dict[str, Any]) -> DriverConfig:
    """The settings, checked; raises ConfigError for an unknown name, wrong type or value out of bounds."""
    return from_mapping(data, DriverConfig, "driver")
