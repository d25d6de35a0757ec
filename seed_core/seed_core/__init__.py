# SPDX-License-Identifier: Apache-2.0
"""Spatial algebra, the stiffness map of a grasp (Theorem 1) and what every package shares: numpy and scipy only.

    from seed_core import Bushing, Stiffness, Wrench, pose_from_rpy

    grasp = Bushing(Stiffness(rotation=(4.0, 3.0, 4.0), translation=(800.0, 1200.0, 800.0)))
    wrench_T = grasp.wrench(pose_from_rpy((0.0, 0.1, 0.0), (0.0, 0.0, 0.01)))  # at the displacement X_TC
    X_TC = grasp.pose(wrench_T)                                                # and back

Frames: W world, E flange, C compliance frame of the gripper, T tool; X_AB is the pose of B in A.
"""

from seed_core.bushing import Bushing, BushingError, Stiffness
from seed_core.config import ConfigError
from seed_core.errors import FailedError, SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, GRAVITY, Frame, Hand, Tool, weight_about_T
from seed_core.spatial import (
    Array,
    SpatialError,
    Wrench,
    inverse_pose,
    make_pose,
    pose_from_quaternion,
    pose_from_rpy,
    so3_exp,
    so3_log,
)
from seed_core.stiffness_file import load_stiffness, save_stiffness

__all__ = [
    "DEFAULT_STIFFNESS",
    "GRAVITY",
    "Array",
    "Bushing",
    "BushingError",
    "ConfigError",
    "FailedError",
    "Frame",
    "Hand",
    "RelativePoseEstimate",
    "SeedError",
    "SpatialError",
    "Stiffness",
    "Tool",
    "Wrench",
    "inverse_pose",
    "load_stiffness",
    "make_pose",
    "pose_from_quaternion",
    "pose_from_rpy",
    "save_stiffness",
    "so3_exp",
    "so3_log",
    "weight_about_T",
]
