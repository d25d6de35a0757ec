# SPDX-License-Identifier: Apache-2.0
"""A tool pressed with F at lever H on an angle-controlled axis of stiffness k leans further than it is turned.

It turns by G = 1 / (1 - F H / k) times what the gripper turns, and tips where k < F H.
"""

from __future__ import annotations

from seed_control.setpoint.setpoints import Flags
from seed_core.bushing import Stiffness
from seed_core.spatial import Array

_LEAST_MARGIN = 0.1  # of stiffness against tipping that is still told apart


def tipping_moment(force_T: Array, p_Ttip: Array) -> float:
    """F H [N m], positive when the tip is pressed away from T; force_T (3,) [N] of the tool, in T, p_Ttip (3,) [m]."""
    return float(force_T @ p_Ttip)


def tipping_gain(force_T: Array, p_Ttip: Array, torque_axes: Flags, stiffness: Stiffness) -> float:
    """G on the weakest axis that holds its angle; force_T (3,) [N] wanted of the tool, in T, p_Ttip (3,) [m]."""
    moment = tipping_moment(force_T, p_Ttip)
    k = [k for k, on in zip(stiffness.rotation, torque_axes, strict=True) if not on]
    if moment <= 0.0 or not k:
        return 1.0
    return 1.0 / max(1.0 - moment / min(k), _LEAST_MARGIN)
