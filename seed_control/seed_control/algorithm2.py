# SPDX-License-Identifier: Apache-2.0
"""Algorithm 2: force control with SEED (Sec. V-B of the paper), the heart of every law of this package.

The wanted wrench becomes a wanted displacement of the grasp by the inverse of its stiffness map, and the displacement
a wanted pose of the gripper, which the arm's position controller reaches. Algorithm 1 is the one-dimensional case.

The law `published` is Algorithm 2, hybrid by the partial inverses of Sec. V-C: they take the place of the whole inverse
in line 5.
"""

from collections.abc import Callable

from seed_core.spatial import Array, Wrench

InverseMap = Callable[[Wrench], Array]  # from the spring's wrench on the tool, about T's origin in T, to X_TC (4, 4)


def force_control(wrench_W: Wrench, X_WT: Array, p_Ttip: Array, inverse_map: InverseMap) -> tuple[Array, Array]:
    """Wanted displacement and gripper pose, so that the tool exerts a wrench: Algorithm 2 line by line.

    Args:
        wrench_W: line 1, wanted torque [N m] and force [N] of the tool on the environment, about the tip, in W.
        X_WT: (4, 4) present pose of the tool.
        p_Ttip: (3,) the tip in T [m].
        inverse_map: line 2, of the estimated stiffness: `Bushing.pose` (Theorem 1, Eq. 5), or a partial inverse.

    Returns:
        X_TC (4, 4), the wanted displacement of the grasp, and X_WC (4, 4), the gripper pose to command.

    Raises:
        BushingError: from `Bushing.pose`, when no displacement gives the wrench.
    """
    wrench_T = wrench_about_T(wrench_W, X_WT[:3, :3], p_Ttip)  # line 4: adjoint transform with the present position
    X_TC = inverse_map(wrench_T)  # line 5: wanted displacement
    return X_TC, gripper_pose(X_WT, X_TC)  # line 6; line 7, the position command, is the caller's


def wrench_about_T(wrench_W: Wrench, R_WT: Array, p_Ttip: Array) -> Wrench:
    """Line 4: a wrench about the tip, written in W, as one about T's origin, written in T.

    Args:
        R_WT: (3, 3) present rotation of the tool.
        p_Ttip: (3,) [m].
    """
    return wrench_W.rotated(R_WT.T).about(-p_Ttip)


def gripper_pose(X_WT: Array, X_TC: Array) -> Array:
    """Line 6: X_WC (4, 4), where the tool at X_WT (4, 4) is displaced by X_TC (4, 4) in the grasp."""
    X_WC: Array = X_WT @ X_TC
    return X_WC
