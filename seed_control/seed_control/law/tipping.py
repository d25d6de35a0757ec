# SPDX-License-Identifier: Apache-2.0
"""A tool pressed with F at lever H on an angle-controlled axis of stiffness k leans further than it is turned.

It turns by G = 1 / (1 - F H / k) times what the gripper turns, and tips where k < F H.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from seed_control.setpoint.setpoints import Flags, SetpointError
from seed_core.bushing import Stiffness
from seed_core.spatial import Array

_LEAST_MARGIN = 0.1  # of stiffness against tipping that is still told apart


def _moment(force_T: Array, p_Ttip: Array) -> float:
    """F H [N m], positive when the tip is pressed away from T."""
    return float(force_T @ p_Ttip)


def tipping_gain(force_T: Array, p_Ttip: Array, torque_axes: Flags, stiffness: Stiffness) -> float:
    """G on the weakest axis that holds its angle; force_T (3,) [N] wanted of the tool, in T, p_Ttip (3,) [m]."""
    moment = _moment(force_T, p_Ttip)
    k = [k for k, on in zip(stiffness.rotation, torque_axes, strict=True) if not on]
    if moment <= 0.0 or not k:
        return 1.0
    return 1.0 / max(1.0 - moment / min(k), _LEAST_MARGIN)


def check_tipping(force_T: Array, p_Ttip: Array, torque_axes: Flags, stiffness: Stiffness, margin: float) -> None:
    """SP14: pressing with F at lever H tips a tool whose angle-controlled axes are softer than F H."""
    size = sqrt(float(force_T @ force_T))
    moment = _moment(force_T, p_Ttip)
    if size == 0.0 or moment <= 0.0:
        return
    along = np.abs(force_T) / size
    for i, k in enumerate(stiffness.rotation):
        if torque_axes[i] or along[i] > 0.9:  # about the force's own axis nothing tips
            continue
        if k < margin * moment:
            raise SetpointError(
                "SP14",
                f"the tool would tip: {size:.3g} N at a lever of {moment / size:.3g} m needs more than "
                f"{margin * moment:.3g} N m/rad about T's {'xyz'[i]}, the grasp has {k:.3g}: ask for at most "
                f"{size * k / (margin * moment):.3g} N or a stiffer grip",
            )
