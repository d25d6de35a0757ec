# SPDX-License-Identifier: Apache-2.0
"""Every setting of the driver, with unit, bounds and meaning; the node declares its parameters from here."""

from __future__ import annotations

from dataclasses import Field, asdict, dataclass, field, fields, replace
from math import isfinite
from typing import Any, cast

from seed_core.errors import SeedError
from seed_core.ur_models import MODELS

Numbers = tuple[float, ...]


def _setting(
    default: Any, unit: str, text: str, low: float = 0.0, high: float = 0.0, live: bool = False
) -> Any:
    """A dataclass field; `live` settings may be changed while the driver is active."""
    return field(
        default=default, metadata={"unit": unit, "text": text, "low": low, "high": high, "live": live}
    )


def _live(default: Any, unit: str, text: str, low: float, high: float) -> Any:
    return _setting(default, unit, text, low, high, live=True)


@dataclass(frozen=True)
class DriverConfig:
    """Settings; `check` refuses what is out of bounds."""

    robot_ip: str = _setting("", "", "address of the controller; must be set")
    model: str = _setting("ur5e", "", "arm: " + " or ".join(MODELS))
    calibration_file: str = _setting(
        "", "", "kinematics YAML written by ur_calibration; empty: published lengths"
    )
    frequency: float = _setting(0.0, "Hz", "servo rate; 0: 500 (125 on CB3)", 0.0, 500.0)
    base_frame: str = _setting("base", "", "name of UR's base frame")
    flange_frame: str = _setting("tool0", "", "name of the flange frame")
    joint_prefix: str = _setting("", "", "put before every joint's name")
    publish_rate: float = _setting(
        250.0, "Hz", "rate of current_pose; twist and wrench half, joints a quarter", 10.0, 500.0
    )
    realtime_priority: int = _setting(
        60, "", "SCHED_FIFO priority of the servo process when allowed; 0: none", 0, 98
    )
    cpu: int = _setting(-1, "", "processor for the servo process; -1: any", -1, 1023)
    watchdog_frequency: float = _setting(
        10.0, "Hz", "the robot stops by itself below this command rate", 1.0, 100.0
    )
    servo_gain: float = _live(300.0, "", "servoj gain", 100.0, 2000.0)
    servo_lookahead: float = _live(0.03, "s", "servoj lookahead time", 0.03, 0.2)
    max_speed: float = _live(0.25, "m/s", "largest commanded speed of the flange", 1e-3, 3.0)
    max_turning: float = _live(0.5, "rad/s", "largest commanded angular speed of the flange", 1e-3, 10.0)
    max_acceleration: float = _live(1.0, "m/s^2", "largest commanded acceleration", 0.01, 50.0)
    max_turning_acceleration: float = _live(
        4.0, "rad/s^2", "largest commanded angular acceleration", 0.01, 100.0
    )
    max_jerk: float = _live(
        250.0, "m/s^3", "largest commanded jerk; sets the length of the final smoothing", 1.0, 1e5
    )
    max_joint_speed: float = _live(
        1.0, "rad/s", "largest commanded joint speed (never above the arm's own)", 0.01, 6.3
    )
    max_step: float = _live(
        0.05, "m", "a target further than this from the command is refused as a jump", 1e-4, 1.0
    )
    max_turning_step: float = _live(
        0.2, "rad", "a target turned further than this is refused as a jump", 1e-3, 3.0
    )
    workspace_low: Numbers = _live(
        (-1.4, -1.4, -0.6), "m", "lower corner of the box the flange may be in", -5.0, 5.0
    )
    workspace_high: Numbers = _live(
        (1.4, 1.4, 1.6), "m", "upper corner of the box the flange may be in", -5.0, 5.0
    )
    command_timeout: float = _live(
        0.1, "s", "a target older than this, or none for this long, stops the arm", 0.01, 2.0
    )
    payload_mass: float = _live(0.0, "kg", "mass of gripper and tool for the controller", 0.0, 20.0)
    payload_cog: Numbers = _live((0.0, 0.0, 0.0), "m", "its centre of mass in the flange frame", -1.0, 1.0)
    tcp: Numbers = _live(
        (0.0,) * 6, "m, rad", "TCP in the flange frame (pose vector); topics stay in the flange", -4.0, 4.0
    )
    speed_slider: float = _live(1.0, "", "speed slider of the pendant", 0.01, 1.0)

    def check(self) -> DriverConfig:
        """Itself, or SeedError naming the setting, its value, unit and bounds."""
        if not self.robot_ip:
            raise SeedError("robot_ip is empty: give the controller's address, e.g. robot_ip:=192.168.56.101")
        if self.model not in MODELS:
            raise SeedError(f"model = {self.model!r} is not known; choose one of {', '.join(MODELS)}")
        for setting in settings():
            _check_numbers(setting, getattr(self, setting.name))
        if any(a >= b for a, b in zip(self.workspace_low, self.workspace_high, strict=True)):
            raise SeedError(
                f"workspace_low = {self.workspace_low} m must be below workspace_high = {self.workspace_high} m"
            )
        return self

    def changed(self, **values: Any) -> DriverConfig:
        """A checked copy with other values."""
        known = {s.name for s in settings()}
        for name in values:
            if name not in known:
                raise SeedError(f"{name!r} is no setting of the driver")
        return replace(self, **{n: tuple(v) if isinstance(v, list) else v for n, v in values.items()}).check()

    def to_json(self) -> dict[str, Any]:
        """Plain data for the servo process."""
        return asdict(self)


def settings() -> tuple[Field[Any], ...]:
    """The fields of DriverConfig with their metadata."""
    return fields(DriverConfig)


def live_settings() -> frozenset[str]:
    """Names of what may be changed while active."""
    return frozenset(s.name for s in settings() if s.metadata["live"])


def _check_numbers(setting: Field[Any], value: Any) -> None:
    low, high, unit = setting.metadata["low"], setting.metadata["high"], setting.metadata["unit"]
    if isinstance(setting.default, str):
        if not isinstance(value, str):
            raise SeedError(f"{setting.name} = {value!r} must be text")
        return
    if isinstance(setting.default, tuple):
        values = list(value)
        if len(values) != len(setting.default):
            raise SeedError(f"{setting.name} = {values} must have {len(setting.default)} numbers [{unit}]")
    else:
        values = [value]
    for number in values:
        if isinstance(number, bool) or not isinstance(number, int | float) or not isfinite(number):
            raise SeedError(f"{setting.name} = {number!r} must be a finite number [{unit}]")
        if not low <= number <= high:
            raise SeedError(f"{setting.name} = {number} {unit} must be {low} to {high}".replace("  ", " "))


def from_json(data: dict[str, Any]) -> DriverConfig:
    """The settings written by `to_json`."""
    return cast(DriverConfig, DriverConfig().changed(**data))
