# SPDX-License-Identifier: Apache-2.0
"""What the soft grasp does to the tool in the plant, where it is not Drake's own bushing."""

from math import hypot
from typing import NamedTuple, Protocol

import numpy as np

from seed_core.arm.quaternion import to_pose
from seed_core.spatial import Array, Wrench, cross, inverse_pose


class GraspForce(Protocol):
    """A grasp whose wrench the plant asks for at every (sub-)step."""

    def wrench(self, X_TC: Array, V_TC: Array, t: float) -> Wrench:
        """Load on the tool about T's origin, in T.

        Args:
            X_TC: (4, 4) pose of C in T.
            V_TC: (6,) velocity of C in T: angular [rad/s], then that of C's origin [m/s], written in T.
            t: [s] of the plant. It rises; the last is asked for once more when somebody reads the load.
        """
        ...

    def reset(self, t: float) -> None:
        """The tool is taken anew at time t [s], to which time may have gone back: forget what the grasp has been."""
        ...


class Relative(NamedTuple):
    """C in T (4, 4), how it moves there (6,), both as `GraspForce.wrench` takes them, and T's rotation in the world."""

    X_TC: Array
    V_TC: Array
    R_WT: Array


def relative(state: Array, tool_at: tuple[int, int], gripper_at: tuple[int, int]) -> Relative:
    """The gripper in the tool's frame, from Drake's state; `..._at`: where it has a body's pose and velocity."""
    X_WT, X_WC = pose_in(state, tool_at[0]), pose_in(state, gripper_at[0])
    V = state[gripper_at[1] : gripper_at[1] + 6] - state[tool_at[1] : tool_at[1] + 6]
    R_WT = X_WT[:3, :3]
    w_T = state[tool_at[1] : tool_at[1] + 3]
    V_TC = np.empty(6)
    V_TC[:3] = V[:3] @ R_WT
    V_TC[3:] = (V[3:] - cross(w_T, X_WC[:3, 3] - X_WT[:3, 3])) @ R_WT
    return Relative(inverse_pose(X_WT) @ X_WC, V_TC, R_WT)


def pose_in(state: Array, i: int) -> Array:
    """Pose (4, 4) of the body whose quaternion starts at i of Drake's state."""
    w, x, y, z, *p = state[i : i + 7].tolist()
    n = hypot(w, x, y, z)  # Drake's quaternion drifts from one
    return to_pose((p[0], p[1], p[2]), (x / n, y / n, z / n, w / n))
