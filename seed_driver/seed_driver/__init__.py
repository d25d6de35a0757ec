# SPDX-License-Identifier: Apache-2.0
"""Driver for Universal Robots arms: servoing at 500 Hz with limits and link supervision.

Without ROS: a `Supervisor(DriverConfig(robot_ip=...))`, its `step` called often, `write_target` for each target.
"""

from seed_driver.config import DriverConfig
from seed_driver.motion.calibrated_kinematics import arm_kinematics, load_calibration
from seed_driver.motion.limiter import CommandLimiter
from seed_driver.process.shared_memory import RobotState, ServoState, Stage
from seed_driver.process.supervisor import Reply, Supervisor
from seed_driver.robot.link import LinkError
from seed_driver.target_guard import GuardConfig, TargetGuard

__all__ = [
    "CommandLimiter",
    "DriverConfig",
    "GuardConfig",
    "LinkError",
    "Reply",
    "RobotState",
    "Stage",
    "ServoState",
    "Supervisor",
    "TargetGuard",
    "arm_kinematics",
    "load_calibration",
]
