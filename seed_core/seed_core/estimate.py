# SPDX-License-Identifier: Apache-2.0
"""What an estimator of the tool's pose in the grasp tells a controller: the core's form of seed_msgs/RelativePose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seed_core.spatial import Array

AXES = ("x", "y", "z", "roll", "pitch", "yaw")


def _unknown_covariance() -> Array:
    return np.zeros((6, 6))


@dataclass(frozen=True)
class RelativePoseEstimate:
    """Pose of the tool T in the compliance frame C at the time an image was taken.

    Attributes:
        stamp: when the images were taken [s].
        X_CT: (4, 4).
        covariance: (6, 6) of [rotation vector in C, translation in C] [rad^2, rad m, m^2].
        observed: whether the estimator sees each of AXES (x, y, z, roll, pitch, yaw): translation first, unlike the
            covariance. Read it by `observed_translation` and `observed_rotation`.
        valid: False means: do not use the pose; `reason` says why.
        slip: share of the tool's motion that the membrane does not follow, 0 (sticks) to 1.
        gross_slip: the tool has slid in the grasp since the last grasp; the pose is no longer relative to it.
    """

    stamp: float
    X_CT: Array
    covariance: Array = field(default_factory=_unknown_covariance)
    observed: tuple[bool, bool, bool, bool, bool, bool] = (True,) * 6
    valid: bool = True
    reason: str = ""
    slip: float = 0.0
    gross_slip: bool = False
    method: str = ""

    @property
    def observed_translation(self) -> tuple[bool, bool, bool]:
        """Whether x, y, z of C are seen."""
        return self.observed[0], self.observed[1], self.observed[2]

    @property
    def observed_rotation(self) -> tuple[bool, bool, bool]:
        """Whether roll, pitch, yaw are seen."""
        return self.observed[3], self.observed[4], self.observed[5]
