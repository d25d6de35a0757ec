# SPDX-License-Identifier: Apache-2.0
"""Noisy relative poses, as an estimator would tell them that has a fault."""

from dataclasses import replace

import numpy as np

from seed_core.estimate import Regrasp, RelativePoseEstimate
from seed_core.spatial import inverse_pose, make_pose, rotation_from_rpy, rpy_from_rotation, so3_exp
from seed_sim.closed_loop.relative_poses import NoisyPoses
from seed_sim.faults.draw import Fault
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario

_AVERAGED = 8  # images that a new grasp is the mean of


class FaultyPoses(NoisyPoses):
    """What `Fault` says, from its moment on."""

    def __init__(self, scenario: Scenario, fault: Fault) -> None:
        super().__init__(scenario, fault.seed, np.eye(4))
        self._fault = fault
        self._frozen: RelativePoseEstimate | None = None
        self._regrasp, self._taken = Regrasp(), -1  # images since a new grasp was asked for; -1: not yet
        self._chance = np.random.default_rng([fault.seed, 0xFB])

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        fault, estimate = self._fault, super().measure(plant, stamp)
        if plant.time < fault.since:
            self._frozen = estimate
            return estimate
        if fault.kind == "late stamps":
            return replace(estimate, stamp=stamp + fault.shift)
        if fault.kind == "frozen poses" and self._frozen is not None:
            return replace(self._frozen, stamp=stamp)
        if fault.kind == "axis lost":
            return self._lost(estimate)
        if fault.kind == "wrong masks" and self._chance.random() < fault.share:
            return self._off(estimate)
        if fault.kind == "initialized while pressing":
            return self._regrasped(plant, estimate)
        return estimate

    def _lost(self, estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        lost = self._fault.axes
        values = np.array((*estimate.X_CT[:3, 3], *rpy_from_rotation(estimate.X_CT[:3, :3])))
        if not self._fault.told:
            values[list(lost)] = 0.0
        observed = tuple(i not in lost for i in range(6))
        X_CT = make_pose(rotation_from_rpy(values[3:]), values[:3])
        return replace(estimate, X_CT=X_CT, observed=observed)  # type: ignore[arg-type]

    def _off(self, estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        """By the bias where all poses are, else by as much to any side."""
        bias = self._fault.bias
        if self._fault.share < 1.0:
            bias = np.abs(bias) * self._chance.uniform(-1.5, 1.5, 6)
        X = estimate.X_CT
        return replace(estimate, X_CT=make_pose(so3_exp(bias[:3]) @ X[:3, :3], X[:3, 3] + bias[3:]))

    def _regrasped(self, plant: Plant, estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        """T := C where the tool is now, announced as every estimator of ours does."""
        if self._taken < 0:
            self._regrasp.begin("grasp")
        self._taken += 1
        if self._taken == _AVERAGED:
            self._X_TT0 = inverse_pose(plant.X_CT)
            self._regrasp.end()
        return self._regrasp.through(estimate)
