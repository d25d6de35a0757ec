# SPDX-License-Identifier: Apache-2.0
"""How well the wrench is known: its covariance, of some of the images, since it changes slowly and takes time."""

from math import inf

import numpy as np

from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_core.spatial import Array, Wrench

PERIOD = 0.1  # [s] at least between two covariances


class WrenchKnowledge:
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
