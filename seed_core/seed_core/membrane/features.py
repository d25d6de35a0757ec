# SPDX-License-Identifier: Apache-2.0
"""What the wrench of a grasp is computed from: the motion of both fingers' membranes as one vector.

Each finger gives 16 numbers: rotation vector and shift of the material around its patch, the shift taken at the middle
of the patch, the nine deformations of `MembraneMotion`, and the rise of its pressure since the grasp. The fingers face
each other along y of C, so that the right one, seen in a mirror (y turned over), is a left one. Half the sum of both,
the finger and the mirrored other, is the common part of a feature ('x+'), half the difference the other part ('x-').
A tool that sticks and moves along x moves 'x+', along y 'y-'.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from seed_core.errors import SeedError
from seed_core.estimate import DEFORMATIONS, MembraneMotion
from seed_core.hand import FINGERS
from seed_core.spatial import Array, skew, so3_log

Motions = tuple[MembraneMotion, MembraneMotion]  # of the left and of the right finger
RIGID = ("roll", "pitch", "yaw", "x", "y", "z")
DEFORMATION = ("x by u", "z by v", "shear", "x by uu", "x by uv", "x by vv", "z by uu", "z by uv", "z by vv")
OF_FINGER = (*RIGID, *DEFORMATION, "pressure")
NAMES = tuple(f"{name}{part}" for part in "+-" for name in OF_FINGER)
STICKING = [NAMES.index(n) for n in ("roll-", "pitch+", "yaw-", "x+", "y-", "z+")]  # what a tool that sticks moves
COUNT = len(NAMES)  # 32
PER_FINGER = len(OF_FINGER)  # 16
MIRROR = np.array((-1.0, 1.0, -1.0, 1.0, -1.0, 1.0) + (1.0,) * 10)  # sign of each in the mirror
WRENCH_MIRROR = np.array((-1.0, 1.0, -1.0, 1.0, -1.0, 1.0))  # of torque and force
SCALE = np.array((0.07,) * 3 + (2e-3,) * 3 + (3e-4,) * 9 + (2.0,))  # [rad, m, hPa] of ordinary motions: unit in a map
SCALES = np.tile(SCALE, 2)
_MIX = 0.5 * np.block([[np.eye(PER_FINGER), np.diag(MIRROR)], [np.eye(PER_FINGER), -np.diag(MIRROR)]]) / SCALES[:, None]


class FeatureError(SeedError):
    """A membrane's motion that gives no features."""


def by_finger(membrane: Sequence[MembraneMotion]) -> Motions:
    """The motions of the left and of the right finger.

    Raises:
        FeatureError: one is missing, stands twice, tells no deformation, or has a number that is not finite.
    """
    names = [m.finger for m in membrane]
    if sorted(names) != sorted(FINGERS):
        told = ", ".join(names) or "none"
        raise FeatureError(f"motion of both membranes is needed, left and right; told: {told}")
    left, right = sorted(membrane, key=lambda m: m.finger)
    for m in (left, right):
        if len(m.deformation) != DEFORMATIONS:
            raise FeatureError(f"the {m.finger} membrane has {len(m.deformation)} of {DEFORMATIONS} deformations")
        if not np.isfinite(m.X_CM[:3].sum() + m.deformation.sum()):
            raise FeatureError(f"the {m.finger} membrane's motion is not finite")
    return left, right


def of_finger(motion: MembraneMotion, middle: Array, rise: float = 0.0) -> Array:
    """(16,) [rad, m, hPa] of one finger, whose patch had its middle (3,) [m] at the grasp."""
    R = motion.X_CM[:3, :3]
    shift = R @ middle + motion.X_CM[:3, 3] - middle
    return np.concatenate((so3_log(R), shift, motion.deformation, (rise,)))


def features(motions: Motions, middles: Array, rises: ArrayLike = (0.0, 0.0)) -> Array:
    """(32,) common and other parts, in units of SCALES.

    Args:
        motions: of the left and of the right finger.
        middles: (2, 3) [m] of their patches at the grasp, in C.
        rises: [hPa] of their pressures since the grasp.
    """
    both = [of_finger(m, p, rise) for m, p, rise in zip(motions, middles, np.asarray(rises, float), strict=True)]
    return mixed(*both)


def mixed(left: Array, right: Array) -> Array:
    """(32,) features, in units of SCALES, of both fingers' numbers (16,)."""
    return np.asarray(_MIX @ np.concatenate((left, right)))


def feature_covariance(motions: Motions, middles: Array) -> Array:
    """(32, 32) of the features, from the covariance of the rigid motions; of deformations none is known."""
    out = np.zeros((COUNT, COUNT))
    for i, (m, p) in enumerate(zip(motions, middles, strict=True)):
        of_pose = np.eye(6)  # a turn about C's origin shifts the middle as well
        of_pose[3:, :3] = -skew(m.X_CM[:3, :3] @ p)
        J = _MIX[:, PER_FINGER * i : PER_FINGER * i + 6] @ of_pose
        out += J @ m.covariance @ J.T
    return out


def gripper_rates(motions: Motions, middles: Array) -> Array:
    """(32, 6) d features while the tool sticks and C moves: by its turn [rad] and by its origin's shift [m], in C."""
    rates = np.zeros((2, PER_FINGER, 6))
    for of, m, p in zip(rates, motions, middles, strict=True):
        half = 0.5 * skew(so3_log(m.X_CM[:3, :3]))  # inverse left Jacobian, up to angle^2 / 12
        of[:3, :3] = -np.eye(3) + half
        of[3:6, :3] = skew(m.X_CM[:3, :3] @ p + m.X_CM[:3, 3])
        of[3:6, 3:] = -np.eye(3)
    return np.asarray(_MIX @ rates.reshape(32, 6))
