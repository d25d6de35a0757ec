# SPDX-License-Identifier: Apache-2.0
"""The controller: Algorithm 2 and hybrid control in a loop that knows when to stop.

A set-point goes checks -> law -> flange command (which owns the limiter), an image inputs -> wrench estimate -> law.

Inputs come with their own stamps, time comes as an argument, and nothing moves before `enable`. When the estimate or
the kinematics go stale or invalid it decelerates to a hold, latched with the reason, until it is enabled again.
"""

from dataclasses import replace
from math import inf

import numpy as np

from seed_control.algorithm2 import gripper_pose
from seed_control.command.flange_command import FlangeCommand
from seed_control.command.guard import Guard
from seed_control.command.relief import Relief
from seed_control.law.hybrid import HybridLaw
from seed_control.law.published import PublishedLaw
from seed_control.monitor.contact.contact_watch import ContactWatch
from seed_control.monitor.grasp_check import GraspCheck
from seed_control.monitor.plausible import Frozen, Jumped
from seed_control.monitor.pressure_check import PressureCheck
from seed_control.monitor.references import References
from seed_control.monitor.stamp_step import StampStep
from seed_control.parameters import LIVE, ControllerParameters
from seed_control.setpoint.checks import SetpointChecks, unobserved_displacement, unobserved_load
from seed_control.setpoint.setpoints import RelativePoseSetpoint, Setpoint, SetpointError
from seed_control.state import ControllerState, ControlOutput, Counting, Mode
from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_control.wrench.inputs import MOST_BAD, Inputs
from seed_control.wrench.knowledge import WrenchKnowledge
from seed_core.bushing import Bushing, Stiffness
from seed_core.config import checked
from seed_core.errors import SeedError
from seed_core.estimate import NEW_GRASP, RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import Array, Wrench
from seed_core.vector3 import ZERO, as_vector3
from seed_core.wrench_model import WrenchModel
from seed_core.wrench_settings import ReferenceSettings

# The laws that `parameters.LAWS` names. The default `seed` is HybridLaw with the surface observer, `plain` the same
# without it. (The stiffness map's model 'plain' is something else: see seed_core/bushing.py.)
LAW_CLASSES: dict[str, type[PublishedLaw]] = {"seed": HybridLaw, "plain": HybridLaw, "published": PublishedLaw}


AWAY = 0.02  # [m] an arm so far from its command was moved, or held, by something else


class ControlRefusedError(SeedError):
    """A request that does not fit the controller's present state."""


class Controller:
    """One hand, one tool, one arm. Feed it, call `step` at the control rate, send `X_WE` to the arm.

    Attributes:
        wrench_estimator: the stiffness map in use, with the tool's weight.
        references: what the wrench is checked against, and corrected by.
        law: what turns set-points and images into gripper poses.
        checks: of set-points; `checks.clock_problem` says why force must wait for the clocks.
        pressure: whether the bubbles' pressures are those of the identification.
        grasp_check: what speaks against the zero of this grasp.
        watch: what the contact says about clocks and swings. stamps: whether the images' clock was set back.
    """

    def __init__(
        self,
        parameters: ControllerParameters,
        hand: Hand,
        tool: Tool,
        stiffness: Stiffness,
        wrench_model: WrenchModel | None = None,
        references: ReferenceSettings | None = None,
        pressure: PressureCheck | None = None,
    ) -> None:
        """Disabled, until `enable`.

        Args:
            stiffness: of the grasp.
            wrench_model: what the wrench comes from; None: a map of this stiffness. Another model than that brings its
                own local stiffness.
            references: what the wrench is checked against; None: the defaults.
            pressure: check of the bubbles' pressures; None: nothing is known of them.

        Raises:
            ConfigError: a parameter is out of its bounds.
        """
        self.parameters = p = checked(parameters, "controller")
        self.tool, self._X_EC = tool, hand.X_EC
        law = LAW_CLASSES[p.law]
        self._counting = Counting("not enabled yet")
        self._inputs = Inputs(p, law.synchronised, self._counting)
        self._still, self._jumped = Frozen(), Jumped(p)
        self.wrench_estimator = WrenchEstimator(
            tool, Bushing(stiffness, law.model), law.gravity, 1e-3 * p.position_noise, wrench_model
        )
        self.checks = SetpointChecks(p, self.wrench_estimator, hand)
        self.law = law(p, self.wrench_estimator)
        self._known = WrenchKnowledge(self.wrench_estimator)
        checks = checked(references or ReferenceSettings(), "reference")
        if not law.gravity:  # the paper's law has the paper's wrench
            checks = replace(checks, correct=False)
        self.references = References(checks, hand, tool, self.wrench_estimator)
        self.pressure = pressure or PressureCheck()
        self._command = FlangeCommand(p, hand.X_EC)
        self._guard = Guard(p, self._counting, self._command.stopping)
        self.grasp_check = GraspCheck(tool, p.max_unloaded_force)
        self.watch = ContactWatch(p, hand.X_EC[:3, 3])
        self.stamps = StampStep(p.max_stamp_error)
        self._relief = Relief(0.7 * p.max_excess_force, p.max_deflection)
        self._held_at = ZERO  # [m] commanded place at which it came to hold
        self._setpoint: Setpoint | None = None
        self._now, self._step = -inf, 1.0 / p.rate  # [s]
        self._state = self._describe(-inf)

    def add_kinematics(self, stamp: float, X_WE: Array) -> bool:
        """Flange pose X_WE (4, 4) at stamp [s]. False (counted) when it is no pose or its stamp does not rise."""
        return self._inputs.add_kinematics(stamp, X_WE)

    def add_estimate(self, estimate: RelativePoseEstimate) -> bool:
        """A new relative pose. False (counted) when it is invalid, older than the last one, or no pose.

        While force, torque or a displacement is controlled on an axis that it does not observe, it counts as invalid.
        """
        inputs = self._inputs
        still = self._still.check(estimate, inputs.estimate, inputs.history)
        unknown = self._unobserved(estimate) or still or self.wrench_estimator.why_unknown(estimate)
        jump = "" if unknown else self._jump(estimate)
        self._check_stamp(estimate.stamp)
        good = inputs.add_estimate(estimate, unknown or jump)
        if good:
            self.pressure.update(estimate)
            self._guard.hold(self.pressure.reason)
        if inputs.bad_in_a_row >= MOST_BAD:
            self._guard.hold(inputs.why_bad)
            self.references.new_grasp()
            if jump or NEW_GRASP in inputs.why_bad:
                self.grasp_check.new_grasp("" if jump else NEW_GRASP)
        return good

    def refused(self, kind: str, why: str) -> None:
        """An input ('kinematics', 'estimates' or 'setpoints') was refused before it came here: the state tells why."""
        self._inputs.refused(kind, why)

    def add_arm_wrench(self, stamp: float, load: Wrench) -> None:
        """The arm's own force/torque reading at stamp [s]: load on the flange about its origin, in E.

        Raises:
            SeedError: it cannot be used.
        """
        self.references.arm.add(stamp, load)

    def enable(self, t: float) -> None:
        """Allow motion, from where the arm is; also clears a hold.

        While it moves this changes nothing, unless the arm is not where it was sent: then the set-point is dropped.

        Raises:
            ControlRefusedError: the kinematics or the estimate is missing or stale.
        """
        if not self.missing(t)["pose"]:
            self._take_image(t)
        if why := next(filter(None, self.missing(t).values()), ""):
            raise ControlRefusedError(f"cannot enable: {why}")
        here = self._inputs.history.newest()
        if self._guard.following and float(np.abs(here[:3, 3] - self._command.X_WE[:3, 3]).max()) < AWAY:
            return
        self._command.start_from(here)
        self._setpoint = None
        self.law.release()
        self.watch.restart()
        self.grasp_check.restart()
        self._relief.restart()
        self._still.restart()
        self._jumped.restart()
        self._guard.enable(True)
        self._inputs.count_from(t)
        self._state = self._describe(t)  # a task may be asked for before the next step

    def missing(self, t: float) -> dict[str, str]:
        """What `enable` would be refused for, by the input that lacks; '' for what is there."""
        lacks = t - self._inputs.history.newest_stamp > self.parameters.kinematics_timeout
        return {
            "pose": f"no flange pose (current_pose) within the last 0.1 s{self._inputs.why_no_pose}" if lacks else "",
            "estimate": "" if lacks else self._inputs.staleness(t),
            "pressure": self.pressure.reason,
        }

    def hold(self, t: float, reason: str) -> None:
        """Stop, if it moves, for something that others found, until enabled again."""
        self._guard.hold(reason)
        self._state = self._describe(t)

    def disable(self, t: float, reason: str) -> None:
        """Decelerate to rest and ignore set-points until enabled again."""
        self._setpoint = None
        self.law.release()
        self._guard.enable(False, reason or "disabled")
        self._state = self._describe(t)  # whoever plays something sees it at once

    def set_limits(self, parameters: ControllerParameters, t: float) -> None:
        """Use the limits of these parameters (`parameters.LIVE`) from now on.

        A set-point that asks for more force or torque than is allowed now ends in a hold.
        """
        changes = {name: getattr(parameters, name) for name in LIVE}
        self.parameters = p = checked(replace(self.parameters, **changes), "controller")
        self.checks.parameters = self._guard.parameters = self.law.parameters = p
        self._command.set_speeds(p.max_speed, p.max_angular_speed)
        if self.law.setpoint is not None:
            try:
                self.checks.size(self.law.setpoint.wrench)
            except SetpointError as error:
                self.hold(t, f"the limits were lowered: {error}")

    def set_stiffness(self, stiffness: Stiffness, t: float) -> None:
        """Use another stiffness, blended in over `stiffness_blend` so that the arm does not jump."""
        self.wrench_estimator.set_stiffness(
            stiffness, t, self.parameters.stiffness_blend if self._guard.enabled else 0.0
        )

    def set_setpoint(self, setpoint: Setpoint, t: float) -> None:
        """Follow a set-point from now on; the latest wins.

        Raises:
            SetpointError: with the number of the refusal. The former set-point and the motion stay as they were.
        """
        try:
            self._adopt(setpoint, t)
        except SetpointError as error:
            self._counting.count("setpoints_refused", str(error))
            raise
        self._counting.used("setpoints")
        self._setpoint = setpoint

    def _adopt(self, setpoint: Setpoint, t: float) -> None:
        if not self._guard.following:
            why = f"holding: {self._guard.held}" if self._guard.held else "disabled"
            raise SetpointError("SP17", f"the controller is {why}; enable it first")
        checks, law, m, estimate = self.checks, self.law, self.law.measured, self._inputs.estimate
        assert m is not None  # it is enabled with an estimate only
        assert estimate is not None
        checks.stamp(setpoint.stamp, t)
        if isinstance(setpoint, RelativePoseSetpoint):
            checks.displacement(setpoint, estimate)
            law.release()
            return
        hybrid = checks.as_hybrid(setpoint, m)
        if hybrid.differs_in_place_only(law.setpoint):
            checks.place(hybrid.X_W_tip)
            law.move(hybrid)
            return
        checks.load(hybrid, estimate, m.X_WC[:3, :3])
        checks.place(hybrid.X_W_tip)
        law.adopt(hybrid, self._command.p_WC)
        self._command.turn_to(law.plan.X_WC[:3, :3])

    def step(self, t: float) -> ControlOutput:
        """One control step at time t [s]."""
        dt = 1.0 / self.parameters.rate if self._now == -inf else min(max(t - self._now, 1e-4), 0.05)
        self._now = t
        if set_back := self._inputs.set_back(t):
            self._guard.hold(set_back)
            self.stamps.restart()
            self.checks.stamp_problem = ""
        if not self._command.started:
            if not len(self._inputs.history):
                self._state = self._describe(t)
                return ControlOutput(None, self._state)
            self._command.start_from(self._inputs.history.newest())
        self._take_image(t)
        self.wrench_estimator.advance(t)
        guard, law = self._guard, self.law
        if guard.following:
            stale = self._inputs.staleness(t)
            if stale:
                guard.hold(stale)
            command = self._command
            X_WC = self._inputs.history.newest() @ self._X_EC
            guard.check_motion(command.p_WC, law.plan, X_WC, command.lead, self._step)  # the last one's motion
        limits = self._move(t, dt)
        self._step = dt
        self._state = self._describe(t, limits)
        return ControlOutput(self._command.X_WE, self._state)

    def _take_image(self, t: float) -> None:
        """Take in the newest estimate, once the kinematics of its moment are there."""
        matched = self._inputs.match(t)
        if matched is None:
            return
        (estimate, X_WE), before = matched, self.law.measured
        frame = max(estimate.stamp - before.stamp, 0.0) if before is not None else 0.0
        m = self.wrench_estimator.measure(estimate, X_WE @ self._X_EC)
        self.law.image(m, loop_time=min(t - estimate.stamp + 0.5 * frame + self._command.lead, 0.5))
        if self.law.setpoint is not None:
            self._command.turn_to(self.law.plan.X_WC[:3, :3])
        if self.law.contact.lost > self._counting.counters.contacts_lost:
            self._counting.count("contacts_lost")
        self._check_force(m)
        if self._known.update(m, self.law.plan.R_W_task):
            self.references.update(m, self._known.by_pose, self.law.contact.anywhere, t)
            self._guard.hold(self.references.why_hold)
        self.watch.update(m, self.law, self._inputs.history)
        self._guard.hold(self.watch.reason)
        self.grasp_check.update(m, self._pressing(), self.wrench_estimator.mean_stiffness)
        if self._guard.following and self.law.regulates_force:
            self._guard.hold(self.grasp_check.reason)

    def _check_force(self, m: Measurement) -> None:
        """What the newest image says against going on."""
        law, guard, k = self.law, self._guard, self.wrench_estimator.mean_stiffness
        if law.regulates_force:
            wanted = law.plan.wanted @ law.plan.normals
            self._relief.image(m.on_environment.force, wanted, k * m.variance**0.5)
            if guard.held:
                self._relief.give_way(k, m.X_WC[:3, 3], self._held_at)
        guard.check_overload(m)
        guard.free_travel.image(*law.shares())
        if guard.following and law.setpoint is not None:
            guard.check_unexpected(m, law.plan, self.grasp_check.weight)

    def _jump(self, estimate: RelativePoseEstimate) -> str:
        """Why an estimate does not go on from the last one, while force is controlled; '' if it does."""
        law, m = self.law, self.law.measured
        if m is None or not (estimate.valid and self._guard.following and law.regulates_force):
            return ""
        known = self.wrench_estimator
        why = self._jumped.check(estimate, m, self._inputs.history, known.mean_stiffness, known.turning_stiffness)
        self.grasp_check.doubt(self._jumped.newest)
        return why

    def _check_stamp(self, stamp: float) -> None:
        """No force while images are dated by a clock that was set back."""
        self.stamps.update(stamp, self._now)
        self.checks.stamp_problem = self.stamps.reason
        if self.law.regulates_force:
            self._guard.hold(self.stamps.reason)

    def _pressing(self) -> Array | None:
        """Direction (3,) of the wanted force in W, where it is along a single one and weight counts; None elsewhere."""
        plan = self.law.plan
        if len(plan.normals) != 1 or not self._guard.following or not plan.wanted[0] or not self.law.gravity:
            return None
        n: Array = plan.normals[0]
        return n if plan.wanted[0] > 0.0 else -n

    def _move(self, t: float, dt: float) -> tuple[str, ...]:
        """Move the command on; returns the names of the limits that it met."""
        command, law, setpoint, m = self._command, self.law, self._setpoint, self.law.measured
        if not self._guard.following or setpoint is None or m is None:
            if self._relief.way and self._guard.enabled:
                return command.towards(self._relief.target(self._held_at), dt, self.parameters.max_speed)
            self._held_at = command.p_WC
            command.stop(dt)
            return ()
        command.compare(self._inputs.history.newest(), dt)
        if isinstance(setpoint, RelativePoseSetpoint):
            X_WC = gripper_pose(law.tool.X_WT, setpoint.X_TC)
            command.turn_to(X_WC[:3, :3])
            return command.towards(as_vector3(X_WC[:3, 3]), dt, self.parameters.approach_speed)
        lead = command.lead
        p_WC = law.reference.target(dt, lead, lead + t - m.stamp + 0.02, command.p_WC)
        return law.plan.limits + command.towards(p_WC, dt, self.parameters.max_speed)

    def _unobserved(self, estimate: RelativePoseEstimate) -> str:
        """What the set-point controls that the estimate does not observe: it would count as undeflected."""
        law, setpoint = self.law, self._setpoint
        if all(estimate.observed) or setpoint is None or self._guard.held:
            return ""
        if isinstance(setpoint, RelativePoseSetpoint):
            return unobserved_displacement(setpoint.X_TC, estimate)
        assert law.measured is not None  # it is enabled with an estimate only
        assert law.setpoint is not None
        return unobserved_load(law.plan.normals, law.setpoint.torque_axes, estimate, law.measured.X_WC[:3, :3])

    @property
    def state(self) -> ControllerState:
        """The state after the last step."""
        return self._state

    def _mode(self, held: str) -> Mode:
        if not self._guard.enabled:
            return "disabled"
        if held:
            return "holding"
        if self._setpoint is None:
            return "idle"
        if not self.law.regulates_force:  # nor does a relative pose
            return "position"
        return "contact" if self.law.contact.made else "approach"

    def _worth_telling(self) -> str:
        """What does not hold, but explains what is seen."""
        return self._guard.free_travel.warning or self._still.warning or self.watch.warning or self._jumped.warning

    def _describe(self, t: float, limits: tuple[str, ...] = ()) -> ControllerState:
        law, plan, held, setpoint = self.law, self.law.plan, self._guard.held, self._setpoint
        mode, m, hybrid = self._mode(held), law.measured, law.setpoint
        return ControllerState(
            stamp=t,
            mode=mode,
            enabled=self._guard.enabled,
            setpoint_kind=setpoint.kind if setpoint is not None else "",
            desired=hybrid.wrench if hybrid is not None else None,
            estimated=law.estimated_task,
            filtered=law.filtered_task,
            told=m.told if m is not None else None,
            deviation=self._known.deviation,
            covariance=self._known.covariance,
            contradictions=self.references.contradictions,
            doubt=m.doubt if m is not None else "",
            desired_X_TC=setpoint.X_TC if isinstance(setpoint, RelativePoseSetpoint) else plan.X_TC if hybrid else None,
            measured_X_CT=m.X_CT if m is not None else None,
            X_W_tip=law.X_W_tip,
            R_W_task=plan.R_W_task,
            limits_hit=limits,
            reason=held or self._counting.remark or self._worth_telling(),
            in_contact=law.contact.made,
            settled=mode == "contact" and law.settled,
            image_age=t - m.stamp if m is not None else inf,
            counters=self._counting.counters,
        )
