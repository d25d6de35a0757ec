# SPDX-License-Identifier: Apache-2.0
"""Whether a set-point can be followed with this hand, tool, grasp and estimator; refusals SP10 to SP17."""

from __future__ import annotations

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_control.setpoints import HybridSetpoint, SetpointError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, Wrench

_TORQUE_TOLERANCE = 1e-6  # [N m]
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


def check_observed(
    directions: Array, torque_axes: tuple[bool, bool, bool], estimate: RelativePoseEstimate, R_WC: Array
) -> None:
    """SP15: force or torque on an axis that the estimator does not observe (Sec. VIII-B). directions: (m, 3) in W."""
    for n in directions:
        n_C = R_WC.T @ n
        for i in range(3):
            if not estimate.observed_translation[i] and abs(n_C[i]) > _OBSERVED_SHARE:
                raise SetpointError(
                    "SP15",
                    f"force along C's {'xyz'[i]}, which the estimator does not observe: align the force with an "
                    "observed axis of the hand, or use an estimator that sees it",
                )
    for i, on in enumerate(torque_axes):
        if on and not estimate.observed_rotation[i]:
            name = ("roll", "pitch", "yaw")[i]
            raise SetpointError("SP15", f"torque about T's {'xyz'[i]}: the estimator does not observe {name}")


def check_workspace(position: Array, parameters: ControllerParameters) -> None:
    """SP16: a flange position outside of the workspace box."""
    low, high = parameters.workspace_low, parameters.workspace_high
    if not all(a <= x <= b for a, x, b in zip(low, position.tolist(), high, strict=True)):
        raise SetpointError(
            "SP16", f"puts the flange at {np.round(position, 3)} m, outside of the workspace {low} to {high} m"
        )
