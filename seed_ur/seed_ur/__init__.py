# SPDX-License-Identifier: Apache-2.0
"""Universal Robots arms: kinematics and published data, the RTDE codec, and a stand-in controller to test against.

    from seed_ur import URKinematics

    arm = URKinematics.for_model("ur5e")
    X_WE = arm.forward((0.0, -1.7, 2.1, -1.97, -1.57, 0.0))  # `tool0` in `base`, (4, 4)
    q = arm.inverse(X_WE, near=(0.0, -1.7, 2.0, -1.9, -1.5, 0.1))

The stand-in is started with `seed_ur.standin_client.StandIn()`, see docs/ur_controller.md.
"""

from seed_ur.kinematics import KinematicsError, URKinematics
from seed_ur.models import JOINT_NAMES, MODELS, URModel

__all__ = ["JOINT_NAMES", "MODELS", "KinematicsError", "URKinematics", "URModel"]
