# SPDX-License-Identifier: Apache-2.0
"""The membrane map without a force sensor: known weights, held in known attitudes.

At rest the membranes carry the tool, so each attitude and each weight is a known load. They are few, and load little:
this finds the slope of each component over its own motion of the material (the diagonal of the linear map) where the
weights load it, with its interval. How components depend on other motions, on motions apart and on products is beyond
such data, and so is any torque that the weights do not exert.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seed_core.membrane.features import SCALES, Motions, features
from seed_core.spatial import Array, inverse_pose
from seed_sysid.fit.weight import LOADED, WeightError, compliance_line
from seed_sysid.membrane.terms import MAIN
from seed_sysid.stiffness_map import AXES, LOAD_UNITS, wrench_transform

_LEAST = 6  # loads
_LEVER = 0.005  # [m] of the forces; torques below it come with the sag, and other motions bear them as well
NOT_TOLD = "how the axes act on each other, what the fingers do differently, and how the membranes stiffen"


@dataclass(frozen=True)
class WeightSlopes:
    """What weights tell of a membrane map.

    Attributes:
        slope: (6,) [N m/rad, N/m] of torque and force on the tool in C over the roll, pitch, yaw, x, y, z that this
            estimator tells of the material,
            positive where it pulls back; nan where the weights cannot tell. half_width: (6,) of the 95 % interval.
        undetermined: by axis why there is none. residual: (6,) standard deviation [N m, N] around the lines.
    """

    slope: Array
    half_width: Array
    undetermined: dict[str, str]
    residual: Array

    @property
    def caveats(self) -> tuple[str, ...]:
        """What the weights do not tell, in words."""
        return (*(f"{axis}: {why}" for axis, why in self.undetermined.items()), f"not told by weights: {NOT_TOLD}")


def fit_weights(motions: Sequence[Motions], middles: Array, X_CT: Array, wrench: Array) -> WeightSlopes:
    """Slopes from n loads.

    Args:
        motions: of both fingers since one grasp, for each load.
        middles: (2, 3) [m] of the patches at the grasp.
        X_CT: (n, 4, 4) poses of the tool.
        wrench: (n, 6) [N m, N] of the membranes on the tool about T, in T: minus seed_core.hand.weight_about_T.

    Raises:
        WeightError: too few loads, or no axis is loaded.
    """
    if len(motions) < _LEAST:
        raise WeightError(f"{len(motions)} loads are too few: hold weights in at least {_LEAST} attitudes")
    z = np.array([features(m, middles) for m in motions])[:, MAIN] * SCALES[list(MAIN)]
    load = np.array([wrench_transform(X) @ w for X, w in zip(X_CT, wrench, strict=True)])
    slope, half, residual, reasons = np.full(6, np.nan), np.full(6, np.nan), np.full(6, np.nan), dict[str, str]()
    forces = float(np.ptp(load[:, 3:], axis=0).max())
    for j, axis in enumerate(AXES):
        span = float(np.ptp(load[:, j]))
        least = max(LOADED[j], _LEVER * forces if j < 3 else 0.0)
        if span < least:
            reasons[axis] = f"the weights put at most {span:.2g} {LOAD_UNITS[j]} on it (at least {least:.2g})"
            continue
        compliance = compliance_line(load[:, j], -z[:, j])  # the load is known, the motion is measured
        if compliance is None:
            reasons[axis] = (
                f"its load varies by {span:.2g} {LOAD_UNITS[j]} only: too little for the noise of the motion"
            )
            continue
        slope[j] = 1.0 / compliance.slope
        half[j] = compliance.slope_interval / compliance.slope**2
        residual[j] = compliance.scatter / compliance.slope
    if len(reasons) == 6:
        raise WeightError("the weights determine no axis: use heavier ones and turn the hand further")
    return WeightSlopes(slope, half, reasons, residual)


def expected_load(found: WeightSlopes, motions: Motions, middles: Array, X_CT: Array) -> Array:
    """(6,) [N m, N] on the tool about T, in T, as the slopes have it; 0 on components without one."""
    z = features(motions, middles)[list(MAIN)] * SCALES[list(MAIN)]
    return np.asarray(wrench_transform(inverse_pose(X_CT)) @ np.nan_to_num(-found.slope * z))
