# SPDX-License-Identifier: Apache-2.0
"""Stiffness without a force sensor: a calibrated weight, held in a few orientations.

At rest the spring carries the weight: w = -(com x m g, m g) about T, in T. With w = B (K xi) each axis is a line
through its own numbers, xi_j = (B^-1 w)_j / k_j + xi0_j; xi0 is how the grasp sat at its reference. An axis gets a
stiffness only where the weight loads it: a weight whose centre of mass lies at T gives the forces alone.
"""

from dataclasses import dataclass

import numpy as np

from seed_core.bushing import Model
from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_sysid.fit.stiffness_schedule import Line, fit_line
from seed_sysid.stiffness_map import AXES, LOAD_UNITS, stiffness_map

ORIENTATIONS_DEG = ((0, 0), (90, 0), (-90, 0), (180, 0), (0, 90), (0, -90), (45, 0), (0, 45), (-135, 0), (0, -135))
"""Roll and pitch of the hand that load every axis; any other orientations do as well."""
_UNCERTAIN = 0.10  # relative standard deviation above which an axis is not given
LOADED = (1e-3,) * 3 + (0.05,) * 3  # [N m, N]; an axis whose load varies by less is not loaded
_MINIMUM = 4


class WeightError(SeedError):
    """Data of a held weight that give no stiffness."""


@dataclass(frozen=True)
class WeightFit:
    """Stiffness (6,) and its standard deviation, nan where the weight cannot tell, and by axis why it cannot."""

    stiffness: Array
    std: Array
    undetermined: dict[str, str]


def fit_weight(X_TC: Array, wrench: Array, model: Model = "midpoint") -> WeightFit:
    """The stiffness of a grasp that holds a known weight.

    Args:
        X_TC: (n, 4, 4) displacements, one for each orientation.
        wrench: (n, 6) [N m, N] of the spring on the tool about T, in T: minus seed_core.hand.weight_about_T.
        model: the stiffness map.

    Returns:
        The stiffness of the axes that the weight loads, and why it cannot tell the others.

    Raises:
        WeightError: too few orientations, or no axis is loaded.
    """
    if len(X_TC) < _MINIMUM:
        raise WeightError(f"{len(X_TC)} orientations are too few: hold the weight in at least {_MINIMUM}")
    B, xi = stiffness_map(X_TC, model)
    load = np.asarray(np.linalg.solve(B, wrench[:, :, None])[:, :, 0], dtype=float)
    stiffness, std, reasons = np.full(6, np.nan), np.full(6, np.nan), {}
    for j, axis in enumerate(AXES):
        span, unit = float(np.ptp(load[:, j])), LOAD_UNITS[j]
        if span < LOADED[j]:
            kind = "torque" if j < 3 else "force"
            reasons[axis] = f"the weight puts no {kind} on it (at most {span:.2g} {unit})"
            continue
        compliance = compliance_line(load[:, j], xi[:, j])
        if compliance is None:
            reasons[axis] = f"its load varies by {span:.2g} {unit} only: too little for the noise of the poses"
            continue
        stiffness[j], std[j] = 1.0 / compliance.slope, compliance.slope_std / compliance.slope**2
    if len(reasons) == 6:
        raise WeightError("the weight determines no axis: use a heavier one and turn the hand further")
    return WeightFit(stiffness, std, reasons)


def compliance_line(load: Array, deflection: Array) -> Line | None:
    """The line of deflections (n,) over known loads (n,); None where noise hides its slope, or it falls."""
    line = fit_line(load, deflection, np.zeros(len(load)))
    return line if line.slope > 0.0 and line.slope_std <= _UNCERTAIN * line.slope else None
