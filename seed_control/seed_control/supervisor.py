# SPDX-License-Identifier: Apache-2.0
"""What may stop the controller: every check of estimates, images and motion, on the one latch of the guard.

The checks themselves are in monitor/ (what speaks against the estimate) and command/ (what speaks against the motion).
"""

from dataclasses import replace

import numpy as np

from seed_control.command.flange_command import FlangeCommand
from seed_control.command.guard import Guard
from seed_control.command.relief import Relief
from seed_control.law.published import PublishedLaw
from seed_control.monitor.contact.contact_watch import ContactWatch
from seed_control.monitor.grasp_check import GraspCheck
from seed_control.monitor.pose_checks import FrozenPoseCheck, PoseJumpCheck
from seed_control.monitor.pressure_check import PressureCheck
from seed_control.monitor.references import References
from seed_control.monitor.stamp_step import StampStep
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import RelativePoseSetpoint
from seed_control.state import EventLog
from seed_control.wrench.estimate import Measurement
from seed_control.wrench.inputs import MOST_BAD, Inputs
from seed_control.wrench.uncertainty import WrenchUncertainty
from seed_core.config import checked
from seed_core.estimate import EMPTY, NEW_GRASP, RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import Array, length
from seed_core.vector3 import ZERO, Vector3, as_vector3, minus, norm, plus_scaled
from seed_core.wrench_settings import ReferenceSettings


class Supervisor:
    """Looks at what the law has seen and done. It holds; how the arm then comes to rest is the controller's.

    Attributes:
        guard: whether the arm may move.
        references: what the wrench is checked against, and corrected by.
        pressure: whether the bubbles' pressures are those of the identification.
        grasp_check: what speaks against the zero of this grasp.
        watch: what the contact says about clocks and swings.
        stamps: whether the images' clock was set back.
        uncertainty: of the wrench.
        doubtful: what made it hold speaks against the poses, and so against the force to give way to: slowly, and no
            further than lets go of what it pressed with.
        displacement: set-point of the grasp's displacement that is followed; None where another kind is, or none.
    """

    displacement: RelativePoseSetpoint | None = None

    def __init__(
        self,
        parameters: ControllerParameters,
        hand: Hand,
        tool: Tool,
        law: PublishedLaw,
        inputs: Inputs,
        command: FlangeCommand,
        events: EventLog,
        references: ReferenceSettings | None = None,
        pressure: PressureCheck | None = None,
    ) -> None:
        """references, pressure: see the controller. The rest: what is looked at."""
        p, self._law, self._inputs, self._command, self._events = parameters, law, inputs, command, events
        self._wrench_estimator = law.wrench_estimator
        self.guard = Guard(p, events, command.stopping, command.turning)
        settings = checked(references or ReferenceSettings(), "reference")
        if not law.gravity:  # the paper's law has the paper's wrench
            settings = replace(settings, correct=False)
        self.references = References(settings, hand, tool, self._wrench_estimator)
        self.pressure = pressure or PressureCheck()
        self.grasp_check = GraspCheck(tool, p.max_unloaded_force, hand.up)
        self.watch = ContactWatch(p, hand.X_EC[:3, 3])
        self.stamps = StampStep(p.max_stamp_error)
        self.uncertainty = WrenchUncertainty(self._wrench_estimator)
        self._relief = Relief(0.7 * p.max_excess_force, p.max_deflection)
        self._held_at = ZERO  # [m] commanded place of C at which it came to hold
        self.doubtful = False
        self._frozen, self._jumps = FrozenPoseCheck(), PoseJumpCheck(p)

    def set_limits(self, parameters: ControllerParameters) -> None:
        """Use the limits of these parameters from now on."""
        self.guard.parameters = self._jumps.parameters = parameters

    def restart(self) -> None:
        """Enabled anew: what was seen before is over."""
        self.watch.restart()
        self.grasp_check.restart()
        self._relief.restart()
        self.doubtful = False
        self._frozen.restart()
        self._jumps.restart()
        self.follow_displacement(None)
        self.guard.enable(True)

    def follow_displacement(self, setpoint: RelativePoseSetpoint | None) -> None:
        """A displacement of the grasp is followed from now on, or none."""
        self.displacement = setpoint

    @property
    def _loads(self) -> bool:
        """Whether what is followed is to load the grasp."""
        return self._law.regulates_force or self.displacement is not None

    @property
    def warning(self) -> str:
        """What does not hold, but explains what is seen; '' for nothing."""
        return self.guard.free_travel.warning or self._frozen.warning or self.watch.warning or self._jumps.warning

    def add_estimate(self, estimate: RelativePoseEstimate, unobserved: str, t: float) -> bool:
        """Check an estimate and hand it to the inputs; whether it may be used. Too many bad ones in a row hold.

        Args:
            unobserved: what is controlled that it does not observe, which makes it invalid; '' for nothing.
            t: [s] of the last step.
        """
        inputs = self._inputs
        frozen = self._frozen.check(estimate, inputs.estimate, inputs.history)
        unknown = unobserved or frozen or self._wrench_estimator.why_unknown(estimate)
        jump = "" if unknown else self._jump(estimate)
        self.stamps.update(estimate.stamp, t)
        if self._loads:  # no force while images are dated by a clock that was set back
            self._hold_in_doubt(self.stamps.reason)
        good = inputs.add_estimate(estimate, unknown or jump)
        if good:
            self.pressure.update(estimate)
            self.guard.hold(self.pressure.reason)
        else:
            self._wrench_estimator.refused(estimate)
        if inputs.bad_in_a_row >= MOST_BAD:
            if jump or frozen:
                self._hold_in_doubt(inputs.why_bad)
            else:
                self.guard.hold(inputs.why_bad)
            empty = any(word in inputs.why_bad for word in EMPTY)
            if jump or empty or estimate.gross_slip or NEW_GRASP in inputs.why_bad:  # a dark image changes no grasp
                self.references.new_grasp()
            if empty:
                self.grasp_check.let_go()
            if jump or NEW_GRASP in inputs.why_bad:
                self.grasp_check.new_grasp("" if jump else NEW_GRASP)
        return good

    def image(self, m: Measurement, t: float) -> None:
        """Look at an image that the law has taken in, at time t [s]."""
        law, guard = self._law, self.guard
        if law.contact.lost > self._events.counters.contacts_lost:
            self._events.count("contacts_lost")
        self._check_force(m)
        if self.uncertainty.update(m, law.plan.R_W_task):
            self.references.update(m, self.uncertainty.by_pose, law.contact.anywhere, t)
            guard.hold(self.references.why_hold)
            if guard.following:
                guard.hold(self.uncertainty.too_large(self._pressed(m), law.parameters.max_excess_force))
        self.watch.update(m, law, self._inputs.history)
        guard.hold(self.watch.reason)
        self.grasp_check.doubt(self.watch.stepped)
        self.grasp_check.update(m, self._pressing(), self._wrench_estimator.mean_stiffness)
        if guard.following and self._loads:
            self._hold_in_doubt(self.grasp_check.reason)
        if self.displacement is not None:
            guard.displacement_travel.image(self.displacement.X_TC, m.X_TC, self._wrench_estimator.bushing.stiffness)

    def check_clocks(self, problem: str) -> None:
        """Per step: hold what loads the grasp, where the images' dates have come to be in doubt meanwhile."""
        if self._loads and problem:
            self._hold_in_doubt(f"force and torque wait for the clocks: {problem}")

    def check_motion(self, t: float, dt: float) -> None:
        """Per step at t [s], before it moves: inputs that went stale, and the motion of the last step, of dt [s]."""
        guard, command = self.guard, self._command
        if guard.following:
            self._held_at = command.p_WC  # a hold may come between two steps, and with the next image
            guard.hold(self._inputs.staleness(t))
            behind, on = command.behind(self._inputs.history.newest()), self.displacement is not None
            guard.check_motion(command.p_WC, self._law.plan, behind, dt, own=not on)
            if on:
                guard.hold(guard.displacement_travel.step(command.p_WC, command.q_WE, dt))
            else:
                own = not self._law.plan.wanted.any()
                guard.displacement_travel.leave(command.p_WC, command.q_WE, dt, own)

    def retreat(self, p_WC: Vector3) -> Vector3 | None:
        """Where C is to go [m] while it holds, to give way; None: it comes to rest from p_WC, where the command is.

        Back along the force that was wanted, or, from what was in the way of a tool without one, the way that it came.
        """
        if self._relief.way and self.guard.enabled:
            return self._relief.target(self._held_at)
        if self.guard.back_to is not None and self.guard.enabled:
            back = minus(self.guard.back_to, self._held_at)
            most = self.guard.parameters.max_free_travel
            return plus_scaled(self._held_at, min(1.0, most / max(norm(back), most)), back)
        self._held_at = p_WC
        return None

    def _pressed(self, m: Measurement) -> Array:
        """Directions (m, 3) in W along which what is followed loads the grasp."""
        if self.displacement is None:
            return self._law.plan.normals
        p = self.displacement.X_TC[:3, 3]
        size = length(p)
        return (m.X_WT[:3, :3] @ p / size)[None] if size > 0.0 else np.zeros((0, 3))

    def _hold_in_doubt(self, reason: str) -> None:
        """Hold for a reason ('' for none) that speaks against the poses."""
        self.doubtful |= bool(reason) and self.guard.following
        self.guard.hold(reason)

    def _check_force(self, m: Measurement) -> None:
        """What the newest image says against going on."""
        law, guard, k = self._law, self.guard, self._wrench_estimator.mean_stiffness
        if law.regulates_force:
            wanted = law.plan.wanted @ law.plan.normals
            self._relief.image(m.on_environment.force, wanted, k * m.variance**0.5)
            if guard.held:
                self._relief.give_way(k, m.X_WC[:3, 3], self._held_at, self.doubtful)
        guard.check_overload(m)
        R_WC, p_WC = m.X_WC[:3, :3], m.X_WC[:3, 3]
        relaxed = R_WC @ self._wrench_estimator.p_Ttip
        guard.free_travel.image(law.shares(), as_vector3(m.tip - p_WC), as_vector3(relaxed))
        if guard.following and law.setpoint is not None:
            guard.check_unexpected(m, law.plan, self.grasp_check.weight)
            guard.check_turn(m, law.plan)

    def _jump(self, estimate: RelativePoseEstimate) -> str:
        """Why an estimate does not go on from the last one, while force is controlled; '' if it does."""
        m = self._law.measured
        if m is None or not (estimate.valid and self.guard.following and self._loads):
            return ""
        grasp = self._wrench_estimator
        why = self._jumps.check(estimate, m, self._inputs.history, grasp.mean_stiffness, grasp.turning_stiffness)
        self.grasp_check.doubt(self._jumps.newest)
        return why

    def _pressing(self) -> Array | None:
        """Direction (3,) of the wanted force in W, where it is along a single one and weight counts; None elsewhere."""
        plan = self._law.plan
        if len(plan.normals) != 1 or not self.guard.following or not plan.wanted[0] or not self._law.gravity:
            return None
        n: Array = plan.normals[0]
        return n if plan.wanted[0] > 0.0 else -n
