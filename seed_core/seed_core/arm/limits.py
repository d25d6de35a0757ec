# SPDX-License-Identifier: Apache-2.0
"""The limits of a commanded motion, declared once: controller, driver and target guard inherit them as parameters."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field
from seed_core.vector3 import Vector3

LONGEST_SMOOTHING = 0.2  # [s] over which a driver takes the mean of its command to keep the jerk


@dataclass(frozen=True)
class MotionLimits:
    """How fast the flange may be commanded to move, and where."""

    max_speed: float = field(0.25, unit="m/s", low=1e-3, high=3.0, doc="largest commanded speed of the flange")
    max_acceleration: float = field(1.0, unit="m/s^2", low=0.01, high=50.0, doc="largest commanded acceleration")
    max_jerk: float = field(250.0, unit="m/s^3", low=1.0, high=1e5, doc="largest commanded jerk")
    max_angular_speed: float = field(0.5, unit="rad/s", low=1e-3, high=10.0, doc="largest commanded angular speed")
    max_angular_acceleration: float = field(
        4.0, unit="rad/s^2", low=0.01, high=100.0, doc="largest commanded angular acceleration"
    )
    workspace_low: Vector3 = field(
        (-1.4, -1.4, -0.6), unit="m", low=-5.0, high=5.0, doc="lower corner of the flange's box"
    )
    workspace_high: Vector3 = field(
        (1.4, 1.4, 1.6), unit="m", low=-5.0, high=5.0, doc="upper corner of the flange's box"
    )

    def __post_init__(self) -> None:
        if any(low >= high for low, high in zip(self.workspace_low, self.workspace_high, strict=True)):
            raise ConfigError(f"workspace_low = {self.workspace_low} m must be below {self.workspace_high} m")


@dataclass(frozen=True)
class TargetLimits(MotionLimits):
    """Which targets an arm follows: what driver and target guard share beyond the limits of the motion itself."""

    base_frame: str = field("base", doc="name of the frame that targets are in")
    max_step: float = field(0.05, unit="m", low=1e-4, high=1.0, doc="a target further from the command is a jump")
    max_angular_step: float = field(0.2, unit="rad", low=1e-3, high=3.0, doc="a target turned further is a jump")
    command_timeout: float = field(
        0.1, unit="s", low=0.01, high=2.0, doc="largest age of a target, and largest silence"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        a, j = self.max_acceleration, self.max_jerk
        smoothing = 2.0 * a / j  # of seed_driver's limiter
        if smoothing > LONGEST_SMOOTHING:
            raise ConfigError(
                f"max_jerk = {j:g} m/s^3 with max_acceleration = {a:g} m/s^2 smooths targets over {smoothing:.3g} s "
                f"(2 a / j), at most {LONGEST_SMOOTHING:g} s: raise max_jerk or lower max_acceleration"
            )
