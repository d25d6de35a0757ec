# SPDX-License-Identifier: Apache-2.0
"""Everything that the wrench is checked against, in one place: it tells what contradicts it, and corrects it."""

from seed_control.monitor.arm_check import ArmCheck
from seed_control.monitor.correction import Correction
from seed_control.monitor.weight_check import WeightCheck
from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_core.hand import Hand, Tool
from seed_core.spatial import Array
from seed_core.wrench_settings import ReferenceSettings


class References:
    """`update` ten times a second with the newest measurement; `arm.add` each reading of the arm.

    Attributes:
        contradictions: what does not agree with the wrench, each in words with numbers.
    """

    def __init__(self, settings: ReferenceSettings, hand: Hand, tool: Tool, wrench_estimator: WrenchEstimator) -> None:
        self.settings = settings
        self.weight, self.arm = WeightCheck(settings, tool), ArmCheck(settings, hand.X_EC, tool)
        self.correction = wrench_estimator.correction = Correction(settings)
        self._wrench_estimator = wrench_estimator
        self.contradictions: tuple[str, ...] = ()

    def update(self, m: Measurement, by_pose: Array, in_contact: bool, t: float) -> None:
        """Compare a measurement with what else is known at time t [s].

        Args:
            by_pose: (6, 6) covariance of the spring's (torque, force) in T by the pose.
        """
        weight, told = self._wrench_estimator.true_weight(m.X_WT[:3, :3]), m.model_spring.vector()
        self.weight.update(m, m.model_spring, weight, by_pose, in_contact)
        self.arm.update(m, m.model_spring, weight, by_pose, self.weight.passed, t)
        for s in self.weight.passed:
            if s.verified:
                self.correction.learn(s.m.stamp, s.spring, s.load, s.random, s.systematic)
        r = self.arm.reading
        if r is not None:
            self.correction.learn(m.stamp, told, r.wrench, by_pose + r.random, r.systematic)
        self.correction.advance(m.stamp, told)
        self.contradictions = tuple(filter(None, (self.weight.reason, self.arm.reason)))

    @property
    def why_hold(self) -> str:
        """What makes the arm hold; '' for nothing."""
        return self.contradictions[0] if self.contradictions and self.settings.on_contradiction == "hold" else ""

    def new_stiffness(self) -> None:
        """The model has another stiffness: what differed with the former one is told no longer."""
        self.weight.reset()
        self.arm.reset()
        self.contradictions = ()

    def new_grasp(self) -> None:
        """What was found of the last grasp says nothing of the next."""
        self._wrench_estimator.new_grasp()
        self.weight.new_grasp()
        self.arm.reset()
        self.correction.reset()
        self.contradictions = ()
