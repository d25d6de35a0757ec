# SPDX-License-Identifier: Apache-2.0
"""How well the wrench is known: its covariance, of some of the images, since it changes slowly and takes time."""

from math import inf

import numpy as np

from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_core.spatial import Array, Wrench

PERIOD = 0.1  # [s] at least between two covariances


class WrenchUncertainty:
    """Renews the covariance with the images, ten times a second at most.

    Attributes:
        covariance: (6, 6) of the tool's (torque, force) on the environment about the tip, in W; None before an image.
        deviation: the standard deviations, in the task frame.
        by_pose: (6, 6) of the spring's (torque, force) in T by the pose, without what the model is off by.
    """

    def __init__(self, wrench_estimator: WrenchEstimator) -> None:
        self._wrench_estimator = wrench_estimator
        self._stamp = -inf
        self.covariance: Array | None = None
        self.deviation: Wrench | None = None
        self.by_pose = np.zeros((6, 6))

    def update(self, m: Measurement, R_W_task: Array) -> bool:
        """Take in one image; whether the covariance is new."""
        if 0.0 <= m.stamp - self._stamp < PERIOD:  # stamps may be set back
            return False
        self._stamp = m.stamp
        C, self.by_pose = self._wrench_estimator.covariance(m)
        self.covariance = C
        R = R_W_task
        variances = ((R.T @ C[:3, :3]) * R.T).sum(axis=1), ((R.T @ C[3:, 3:]) * R.T).sum(axis=1)
        self.deviation = Wrench(np.sqrt(np.maximum(variances[0], 0.0)), np.sqrt(np.maximum(variances[1], 0.0)))
        return True

    def too_large(self, normals: Array, most: float) -> str:
        """Why forces along these directions (m, 3) in W are not known well enough to be controlled; '' if they are.

        most: [N] that a force may be above what is wanted.
        """
        if self.covariance is None or not len(normals):
            return ""
        deviation = float(np.sqrt(((normals @ self.covariance[3:, 3:]) * normals).sum(axis=1).max()))
        if deviation <= most:
            return ""
        return (
            f"the force is known to {deviation:.1f} N only (one standard deviation, at most max_excess_force = "
            f"{most:g} N): see the covariance of relative_pose, what the estimator's diagnostics say, and what the "
            "identification left unexplained"
        )
