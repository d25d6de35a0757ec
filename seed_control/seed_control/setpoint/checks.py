# SPDX-License-Identifier: Apache-2.0
"""Whether a set-point can be followed with this hand, tool, grasp and estimator; refusals SP10 to SP17."""

from __future__ import annotations

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_core.estimate import AXES, RelativePoseEstimate
from seed_core.spatial import Array, Wrench, inverse_pose, so3_log

_TORQUE_TOLERANCE = 1e-6  # [N m]
_NO_DISPLACEMENT = 1e-6  # [m], [rad]
_OBSERVED_SHARE = 0.2  # how much of a force direction may lie along an unobserved axis


def check_stamp(stamp: float | None, now: float, oldest: float) -> None:
    """SP10: a stamp that is too old, or more than 50 ms in the future."""
    if stamp is not None and not -0.05 <= now - stamp <= oldest:
        raise SetpointError(
            "SP10", f"set-point is stamped {now - stamp:.3f} s ago; at most {oldest:g} s is accepted: check the clocks"
        )


def check_load(wrench: Wrench, parameters: ControllerParameters) -> None:
    """SP11: a force or torque beyond what may be asked for."""
    for name, vector, bound, unit in (
        ("force", wrench.force, parameters.max_force, "N"),
        ("torque", wrench.torque, parameters.max_torque, "N m"),
    ):
        size = float(np.linalg.norm(vector))
        if size > bound * (1 + 1e-9):
            raise SetpointError("SP11", f"{name} of {size:.3g} {unit} is beyond max_{name} = {bound:g} {unit}")


def check_torque_axes(setpoint: HybridSetpoint, torque_T: Array) -> None:
    """SP12: a wanted torque about an axis of T that holds its angle."""
    for i, on in enumerate(setpoint.torque_axes):
        if not on and abs(torque_T[i]) > _TORQUE_TOLERANCE:
            raise SetpointError(
                "SP12",
                f"torque of {torque_T[i]:.3g} N m about T's {'xyz'[i]}, which holds its angle: pair tx with roll, ty "
                "with pitch, tz with yaw; set torque_axes, or give a torque of zero about that axis",
            )


def check_deflection(displacement: Array, angles: Array, parameters: ControllerParameters) -> None:
    """SP13: a wrench that needs more deflection than the grasp endures without slip."""
    d = float(np.linalg.norm(displacement))
    if d > parameters.max_deflection:
        raise SetpointError(
            "SP13",
            f"needs a deflection of {1e3 * d:.1f} mm, at most {1e3 * parameters.max_deflection:.1f} mm is safe "
            "against slip: ask for less force or a stiffer grip",
        )
    worst = float(np.rad2deg(np.abs(angles).max()))
    if worst > parameters.max_rotation:
        raise SetpointError(
            "SP13",
            f"needs a rotation of {worst:.1f} degrees in the grasp, at most {parameters.max_rotation:g} is safe "
            "against slip: ask for less torque or a stiffer grip",
        )


def check_observed(blind: str) -> None:
    """SP15: why an estimator cannot serve a set-point, from `unobserved_load` or `unobserved_displacement`."""
    if blind:
        raise SetpointError("SP15", blind)


def unobserved_load(
    directions: Array, torque_axes: tuple[bool, bool, bool], estimate: RelativePoseEstimate, R_WC: Array
) -> str:
    """Which force or torque lies on an axis that the estimate does not observe (Sec. VIII-B); '' for none.

    Args:
        directions: (m, 3) of force, in W. torque_axes: of T, that carry torque. R_WC: (3, 3) of the gripper.
    """
    for n in directions:
        for i, share in enumerate(R_WC.T @ n):
            if not estimate.observed_translation[i] and abs(share) > _OBSERVED_SHARE:
                return (
                    f"force along C's {'xyz'[i]}, which the estimator does not observe: align the force with an "
                    "observed axis of the hand, or use an estimator that sees it"
                )
    for i, on in enumerate(torque_axes):
        if on and not estimate.observed_rotation[i]:
            return f"torque about T's {'xyz'[i]}: the estimator does not observe {AXES[3 + i]}"
    return ""


def unobserved_displacement(X_TC: Array, estimate: RelativePoseEstimate) -> str:
    """Which part of a wanted displacement X_TC (4, 4) the estimate does not observe; '' for none.

    Along such an axis the tool counts as undeflected, so the gripper would go on and on.
    """
    X_CT = inverse_pose(X_TC)
    parts = *X_CT[:3, 3].tolist(), *so3_log(X_CT[:3, :3]).tolist()
    for name, part, seen, unit in zip(AXES, parts, estimate.observed, ("m",) * 3 + ("rad",) * 3, strict=True):
        if not seen and abs(part) > _NO_DISPLACEMENT:
            return f"a displacement of {part:.3g} {unit} in {name}, which the estimator does not observe"
    return ""


def check_workspace(position: Array, parameters: ControllerParameters) -> None:
    """SP16: a flange position outside of the workspace box."""
    low, high = parameters.workspace_low, parameters.workspace_high
    if not all(a <= x <= b for a, x, b in zip(low, position.tolist(), high, strict=True)):
        raise SetpointError(
            "SP16", f"puts the flange at {np.round(position, 3)} m, outside of the workspace {low} to {high} m"
        )
