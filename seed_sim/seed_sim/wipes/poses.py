# SPDX-License-Identifier: Apache-2.0
"""Noisy relative poses whose noise is correlated in time, or larger or smaller than they state."""

from math import exp, sqrt

import numpy as np

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, make_pose, so3_exp
from seed_sim.closed_loop.relative_poses import NOISE_DELAY, PoseSource, taken_at
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario


class CorrelatedPoses(PoseSource):
    """The exact pose with Gauss-Markov noise of the scenario's size on each axis, late.

    Attributes:
        noise: of each image, time [s] and error of the position (3,) in C [m].
    """

    def __init__(self, scenario: Scenario, seed: int, time: float, stated: float) -> None:
        """time: [s] of correlation, 0: white; stated: the stated standard deviation over the true one."""
        m = scenario.measurement
        super().__init__(scenario, m.rate, NOISE_DELAY, taken_at(scenario))
        self._rng = np.random.default_rng([seed, 2])
        self._keeps = exp(-self.period / time) if time > 0.0 else 0.0
        self._sigma = np.array((np.deg2rad(m.rotation_noise),) * 3 + (1e-3 * m.position_noise,) * 3)
        self._covariance = np.diag(np.square(stated * self._sigma))
        self._unit = self._rng.standard_normal(6)
        self.noise: list[tuple[float, Array]] = []

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        keeps = self._keeps
        self._unit = keeps * self._unit + sqrt(1.0 - keeps * keeps) * self._rng.standard_normal(6)
        error, X = self._sigma * self._unit, plant.X_CT @ self._X_TT0
        self.noise.append((plant.time, error[3:]))
        X = make_pose(so3_exp(error[:3]) @ X[:3, :3], X[:3, 3] + error[3:])
        return RelativePoseEstimate(stamp, X, self._covariance, method="noisy")
