# SPDX-License-Identifier: Apache-2.0
"""What the arm is kept clear of, and how much load it may read: settings that every driver has, on by default."""

from dataclasses import dataclass
from math import tau

from seed_core.arm.limits import TargetLimits
from seed_core.config import ConfigError, field

Vector6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class ClearanceSettings(TargetLimits):
    """Distances and loads at which the arm holds; docs/keeping_clear.md."""

    # fixed while the driver is configured
    hand_file: str = field(
        "", doc="parameters of hand and tool, which become capsules on the flange; empty: bare flange"
    )
    surroundings_file: str = field("", doc="YAML of boxes, planes and further parts on the flange; empty: none")

    # changed at any time
    clearance: float = field(
        0.01, unit="m", low=0.0, high=0.2, doc="least distance from itself, floor, planes and boxes"
    )
    self_check: bool = field(True, doc="keep the arm's links, hand and tool apart")
    floor: bool = field(True, doc="keep links and hand above floor_height; tool and fingers may touch it")
    floor_height: float = field(0.0, unit="m", low=-5.0, high=5.0, doc="z of the floor in base; 0: the mounting plane")
    min_radius: float = field(
        0.15, unit="m", low=0.0, high=2.0, doc="least distance of the flange from the base's axis"
    )
    joint_low: Vector6 = field((-tau,) * 6, unit="rad", low=-tau, high=tau, doc="least angle of each joint")
    joint_high: Vector6 = field((tau,) * 6, unit="rad", low=-tau, high=tau, doc="largest angle of each joint")
    max_arm_force: float = field(100.0, unit="N", low=1.0, high=1000.0, doc="that the arm itself may read at its tool")
    max_arm_torque: float = field(20.0, unit="N m", low=0.1, high=200.0, doc="that the arm itself may read at its tool")
    overload_time: float = field(0.05, unit="s", low=0.0, high=2.0, doc="for which a reading must be beyond that")

    def __post_init__(self) -> None:
        super().__post_init__()
        for i, (low, high) in enumerate(zip(self.joint_low, self.joint_high, strict=True)):
            if low >= high:
                raise ConfigError(f"joint_low[{i}] = {low:g} rad must be below joint_high[{i}] = {high:g} rad")
