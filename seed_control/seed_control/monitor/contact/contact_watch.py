# SPDX-License-Identifier: Apache-2.0
"""What a contact shows while force is controlled: whether images are dated right, and whether the force swings."""

from functools import partial
from itertools import compress
from math import inf

from seed_control.law.published import PublishedLaw
from seed_control.monitor.contact.contact_motion import ContactMotion
from seed_control.monitor.contact.force_watch import ForceWatch
from seed_control.monitor.contact.late_stamps import LateStamps
from seed_control.monitor.contact.swing import Swing
from seed_control.monitor.pose_step import PoseStep
from seed_control.parameters import ControllerParameters
from seed_control.wrench.estimate import Measurement
from seed_control.wrench.history import PoseHistory
from seed_core.spatial import Array

_ROCKS = 2  # torque axes, from which on a tool lies with a face, or is in a hole
_EVERY = 0.1  # [s] between two looks at the motion
_NOISE = 6.0  # deviations of the estimated force that a swing must stand out by
_LEAST_FORCE, _LEAST_SHARE = 0.5, 0.1  # [N], and of the wanted force, that counts as a swing


class ContactWatch:
    """`update` with each image that the law has taken in.

    Attributes:
        late: what the motion says about the stamps. force: whether it is the wanted one.
    """

    def __init__(self, parameters: ControllerParameters, p_EC: Array) -> None:
        """p_EC: (3,) [m] gripper's frame C in the flange."""
        self._motion = ContactMotion(p_EC)
        self.late, self.force = LateStamps(parameters), ForceWatch(parameters.max_excess_force)
        self._swings: list[Swing] = []
        self._steps: list[PoseStep] = []
        self._wanted: list[float] = []
        self._looked = -inf  # [s]

    def restart(self) -> None:
        """Everything is to be seen anew: the controller was enabled."""
        self._motion.clear()
        self._swings, self._steps = [], []
        self.late.restart()
        self.force.clear()

    @property
    def reason(self) -> str:
        """Why to hold; '' while all is well."""
        found = [step.reason for step in self._steps] + [swing.reason for swing in self._swings]
        return self.force.reason or self.late.reason or next(filter(None, found), "")

    @property
    def warning(self) -> str:
        """What is worth telling though it does not hold; '' for nothing."""
        return self.force.warning or self.late.warning or self.stepped

    @property
    def stepped(self) -> str:
        """That poses have stepped while the gripper stood; '' if not."""
        return next((step.warning for step in self._steps if step.warning), "")

    def update(self, m: Measurement, law: PublishedLaw, history: PoseHistory) -> None:
        """Take in an image; law: as it is after it; history: flange poses."""
        plan, wanted = law.plan, law.plan.wanted.tolist()
        along, sizes = (plan.normals @ m.on_environment.force).tolist(), [abs(w) for w in wanted]
        deviation = law.wrench_estimator.mean_stiffness * m.variance**0.5
        other = len(self._wanted) != len(sizes) or any(
            abs(w - before) > _LEAST_SHARE * size for w, before, size in zip(wanted, self._wanted, sizes, strict=True)
        )
        if other:
            self._wanted = wanted
        self._look_for_steps(m, law)
        held = [law.contact.once or law.touches(i) for i in range(len(wanted))]
        if any(w and on for w, on in zip(wanted, held, strict=True)):
            self.force.update(m.stamp, [*compress(along, held)], [*compress(wanted, held)], deviation, law.settled)
        else:
            self.force.clear()
        if not law.contact.made or not any(wanted):
            self._motion.clear()
            self._swings = []
            return
        self._motion.add(m)
        if other or not self._swings:
            self._swings = [Swing() for _ in sizes]
        for swing, force, least in zip(self._swings, along, sizes, strict=True):
            swing.update(m.stamp, force, max(_LEAST_SHARE * least, _LEAST_FORCE, _NOISE * deviation))
        if m.stamp >= self._looked + _EVERY or m.stamp < self._looked:
            self._looked = m.stamp
            rocks = law.setpoint is not None and sum(law.setpoint.torque_axes) >= _ROCKS
            self._look(plan.normals, history, rocks)

    def _look_for_steps(self, m: Measurement, law: PublishedLaw) -> None:
        plan, stiffness = law.plan, law.wrench_estimator.mean_stiffness
        if len(self._steps) != len(plan.normals):
            self._steps = [PoseStep() for _ in plan.normals]
        seen = m.estimate is None or all(m.estimate.observed)  # an axis that is not counts as undeflected
        for i, (step, n, wanted) in enumerate(zip(self._steps, plan.normals, plan.wanted.tolist(), strict=True)):
            if seen and wanted and law.touches(i):
                step.update(m, n, wanted, law.p_Ttip, stiffness)
            else:
                step.clear()

    def _look(self, normals: Array, history: PoseHistory, rocks: bool) -> None:
        """rocks: the tool may turn about its rim, where its deflection follows no gripper."""
        for n, swing in zip(normals, self._swings, strict=True):
            if not rocks:
                self.late.update(self._motion.followed(n, history), partial(self._motion.sure, n, history))
            if swing.suspected and not self.late.reason:
                swing.judge(self._motion.followed(n, history, self.late.error or 0.0))
