# SPDX-License-Identifier: Apache-2.0
"""Published data of UR arms: DH table, limits and link masses.

Sources: Universal Robots, "DH parameters for calculations of kinematics and dynamics" (lengths, masses,
centres of mass); user manuals SW 5.8 (range, speed, torque). Real arms deviate by their calibration
(seed_driver.motion.calibrated_kinematics).

The UR5 and UR10 of a CB3 are other arms: of lengths that put the flange 3 to 8 cm elsewhere (same source). A UR7e has
the lengths of a UR5e (Universal_Robots_ROS2_Description, pull request 333).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, radians
from types import MappingProxyType

from seed_core.errors import SeedError
from seed_core.vector3 import Vector3

Vector6 = tuple[float, float, float, float, float, float]

JOINT_NAMES = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
LINK_NAMES = (
    "shoulder_link",
    "upper_arm_link",
    "forearm_link",
    "wrist_1_link",
    "wrist_2_link",
    "wrist_3_link",
)
ALPHA: Vector6 = (pi / 2, 0.0, 0.0, pi / 2, -pi / 2, 0.0)  # twist of standard DH, the same for every UR [rad]


@dataclass(frozen=True)
class URModel:
    """One arm in standard DH, A_i = Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i), from `base` to `tool0`."""

    name: str
    d: Vector6  # [m]
    a: Vector6  # [m]
    speed: Vector6  # largest joint speed [rad/s]
    torque: Vector6  # largest joint torque [N m]
    mass: Vector6  # of the six moving links [kg]
    com: tuple[Vector3, ...]  # (6, 3) centres of mass, each in its link's DH frame [m]
    range: float = 2 * pi  # every joint turns within +- this [rad]


UR5E = URModel(
    name="ur5e",
    d=(0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996),
    a=(0.0, -0.425, -0.3922, 0.0, 0.0, 0.0),
    speed=(pi,) * 6,  # 180 deg/s
    torque=(150.0, 150.0, 150.0, 28.0, 28.0, 28.0),
    mass=(3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    com=(
        (0.0, -0.02561, 0.00193),
        (0.2125, 0.0, 0.11336),
        (0.15, 0.0, 0.0265),
        (0.0, -0.0018, 0.01634),
        (0.0, 0.0018, 0.01634),
        (0.0, 0.0, -0.001159),
    ),
)
UR10E = URModel(
    name="ur10e",
    d=(0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655),
    a=(0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0),
    speed=(radians(120), radians(120), pi, pi, pi, pi),
    torque=(330.0, 330.0, 150.0, 54.0, 54.0, 54.0),
    mass=(7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
    com=(
        (0.021, 0.0, 0.027),
        (0.38, 0.0, 0.158),
        (0.24, 0.0, 0.068),
        (0.0, 0.007, 0.018),
        (0.0, 0.007, 0.018),
        (0.0, 0.0, -0.026),
    ),
)
MODELS: Mapping[str, URModel] = MappingProxyType({m.name: m for m in (UR5E, UR10E)})


def model(name: str) -> URModel:
    """The arm called `name` ('ur5e' or 'ur10e'); raises SeedError naming the known ones."""
    if name not in MODELS:
        raise SeedError(f"ur model = {name!r} is not known; choose one of {', '.join(MODELS)}")
    return MODELS[name]
