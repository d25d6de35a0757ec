# SPDX-License-Identifier: Apache-2.0
"""What every rival law gets and gives: six axes at the tool's tip, some of them free for force and torque.

Flat vectors (6,) are [rotation, translation]: about T's axes [rad, N m], along the task frame's axes [m, N]. Loads are
of the tool on the environment about the tip, as in a task file: pressing is negative along z.
"""

from typing import NamedTuple, Protocol

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp

TOUCH = 2.0  # [N] along a free axis that counts as contact, above any noise and offset of the sensors


class Wanted(NamedTuple):
    """What the set-point asks of the free axes.

    Attributes:
        load: (6,) [N m, N].
        free: (6,) 1 where load is controlled, 0 where the pose is held.
    """

    load: Array
    free: Array

    def error(self, measured: Array) -> Array:
        """(6,) what is missing, along the free axes."""
        return np.asarray(self.free * (self.load - measured))


class RivalLaw(Protocol):
    """One law. `step` at its own rate while any axis is free and the tool touches, `reset` when none is.

    Attributes:
        period: [s] of its steps.
    """

    period: float

    def step(self, wanted: Wanted, measured: Array) -> Array:
        """Offset (6,) [rad, m] of the tip from its reference, along free axes from where it touched.

        Args:
            wanted: on the free axes.
            measured: load (6,), filtered by nobody yet.
        """

    def reset(self) -> None:
        """Pose control again: forget offset and speed."""


def touches(wanted: Wanted, measured: Array) -> bool:
    """Whether the sensor feels contact along a free direction."""
    return bool((np.abs(measured[3:]) * wanted.free[3:] > TOUCH).any())


def scale(value: float, lever: float) -> Array:
    """(6,) a gain or inertia of translation, and for rotation the same at a lever [m]."""
    return np.array((value * lever * lever,) * 3 + (value,) * 3)


def flange_pose(X_W_tip: Array, offset: Array, R_W_task: Array, X_Ttip: Array, X_CE: Array) -> Array:
    """X_WE (4, 4) that puts a rigidly held tool's tip at X_W_tip (4, 4) plus the offset (6,).

    Args:
        R_W_task: (3, 3) axes of the offset's translation.
        X_Ttip, X_CE: (4, 4) of the tip in the tool, and of the flange in the gripper.
    """
    R_WT = X_W_tip[:3, :3] @ X_Ttip[:3, :3].T @ so3_exp(offset[:3])
    p_tip = X_W_tip[:3, 3] + R_W_task @ offset[3:]
    return np.asarray(make_pose(R_WT, p_tip - R_WT @ X_Ttip[:3, 3]) @ X_CE)
