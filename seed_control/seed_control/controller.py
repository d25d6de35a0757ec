# SPDX-License-Identifier: Apache-2.0
"""The controller: Algorithm 2 and hybrid control in a loop that knows when to stop.

A set-point goes checks -> law -> flange command (which owns the limiter), an image inputs -> wrench estimate -> law.
The supervisor looks at all of it and may make it hold; report.py tells what came of a step.

Inputs come with their own stamps, time comes as an argument, and nothing moves before `enable`. When the estimate or
the kinematics go stale or invalid it decelerates to a hold, latched with the reason, until it is enabled again.
"""

from dataclasses import replace
from math import inf

import numpy as np

from seed_control.algorithm2 import gripper_pose
from seed_control.command.flange_command import FlangeCommand
from seed_control.command.limiter import AT_REST
from seed_control.law.hybrid import HybridLaw
from seed_control.law.published import PublishedLaw
from seed_control.monitor.pressure_check import PressureCheck
from seed_control.parameters import LIVE, ControllerParameters
from seed_control.report import describe
from seed_control.setpoint.checks import SetpointChecks, unobserved_displacement, unobserved_load
from seed_control.setpoint.setpoints import RelativePoseSetpoint, Setpoint, SetpointError, WrenchSetpoint
from seed_control.state import ControllerState, ControlOutput, EventLog
from seed_control.supervisor import Supervisor
from seed_control.wrench.estimate import WrenchEstimator
from seed_control.wrench.inputs import Inputs
from seed_core.bushing import Bushing, Stiffness
from seed_core.config import checked
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import Array, Wrench
from seed_core.vector3 import as_vector3
from seed_core.wrench_model import WrenchModel
from seed_core.wrench_settings import ReferenceSettings

# The laws that `parameters.LAWS` names. The default `seed` is HybridLaw with the surface observer, `plain` the same
# without it. (The stiffness map's model 'plain' is something else: see seed_core/bushing.py.)
LAW_CLASSES: dict[str, type[PublishedLaw]] = {"seed": HybridLaw, "plain": HybridLaw, "published": PublishedLaw}


DOUBTED = 1.25  # a new stiffness may be off by this factor either way: one that follows the grip varies
ANOTHER = 0.05  # by which a stiffness differs that is another, not one that follows the grip
AWAY = 0.02, 0.2  # [m], [rad] beyond its trailing: such an arm was moved, or held, by something else


class ControlRefusedError(SeedError):
    """A request that does not fit the controller's present state."""


class Controller:
    """One hand, one tool, one arm. Feed it, call `step` at the control rate, send `X_WE` to the arm.

    Attributes:
        wrench_estimator: the stiffness map in use, with the tool's weight.
        law: what turns set-points and images into gripper poses.
        checks: of set-points; `checks.clock_problem` says why force must wait for the clocks.
        supervisor: what may make it hold.
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
        self._events = EventLog("not enabled yet")
        self._inputs = Inputs(p, law.synchronised, self._events)
        self.wrench_estimator = WrenchEstimator(
            tool, Bushing(stiffness, law.model), law.gravity, 1e-3 * p.position_noise, wrench_model, hand.up
        )
        self.checks = SetpointChecks(p, self.wrench_estimator, hand)
        self.law = law(p, self.wrench_estimator)
        self._command = FlangeCommand(p, hand.X_EC)
        self.supervisor = Supervisor(
            p, hand, tool, self.law, self._inputs, self._command, self._events, references, pressure
        )
        self._guard = self.supervisor.guard
        self._setpoint: Setpoint | None = None
        self._now, self._step = -inf, 1.0 / p.rate  # [s]
        self._state = self._describe(-inf)

    def add_kinematics(self, stamp: float, X_WE: Array) -> bool:
        """Flange pose X_WE (4, 4) at stamp [s]. False (counted) when it is no pose or its stamp does not rise."""
        return self._inputs.add_kinematics(stamp, X_WE)

    def add_estimate(self, estimate: RelativePoseEstimate) -> bool:
        """A new relative pose. False (counted) when it is invalid, older than the last one, or no pose.

        While force, torque or a displacement is controlled on an axis that it does not observe, it counts as invalid.
        The law presses by the membranes, so it goes by their patches, also where the tool has slid on them.
        """
        estimate = estimate.of_patches()
        good = self.supervisor.add_estimate(estimate, self._unobserved(estimate), self._now)
        self.checks.stamp_problem = self.supervisor.stamps.reason
        return good

    def refused(self, kind: str, why: str) -> None:
        """An input ('kinematics', 'estimates' or 'setpoints') was refused before it came here: the state tells why."""
        self._inputs.refused(kind, why)

    def add_arm_wrench(self, stamp: float, load: Wrench) -> None:
        """The arm's own force/torque reading at stamp [s]: load on the flange about its origin, in E.

        Raises:
            SeedError: it cannot be used.
        """
        self.supervisor.references.arm.add(stamp, load)

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
        if self._guard.following and not self.away(here):
            return
        self._command.start_from(here)
        self._setpoint = None
        self.law.release()
        self.supervisor.restart()
        self._inputs.count_from(t)
        self._state = self._describe(t)  # a task may be asked for before the next step

    def away(self, X_WE: Array) -> bool:
        """Whether an arm at X_WE (4, 4) is not where it was sent: something else has moved or held it."""
        return self._command.behind(X_WE).beyond(*AWAY)

    @property
    def heard(self) -> bool:
        """Whether flange poses and estimates have come at all, usable or not."""
        return self._inputs.heard

    def missing(self, t: float) -> dict[str, str]:
        """What `enable` would be refused for, by the input that lacks; '' for what is there."""
        most = self.parameters.kinematics_timeout
        lacks = t - self._inputs.history.newest_stamp > most
        return {
            "pose": f"no flange pose (current_pose) within the last {most:g} s{self._inputs.why_no_pose}"
            if lacks
            else "",
            "estimate": "" if lacks else self._inputs.staleness(t),
            "pressure": self.supervisor.pressure.reason,
        }

    def hold(self, t: float, reason: str) -> None:
        """Stop, if it moves, for something that others found, until enabled again."""
        self._guard.hold(reason)
        self._state = self._describe(t)

    def disable(self, t: float, reason: str) -> None:
        """Decelerate to rest and ignore set-points until enabled again."""
        self._setpoint = None
        self.law.release()
        self.supervisor.follow_displacement(None)
        self._guard.enable(False, reason or "disabled")
        self._state = self._describe(t)  # whoever plays something sees it at once

    def set_limits(self, parameters: ControllerParameters, t: float) -> None:
        """Use the limits of these parameters (`parameters.LIVE`) from now on.

        A set-point that asks for more force or torque than is allowed now ends in a hold.
        """
        changes = {name: getattr(parameters, name) for name in LIVE}
        self.parameters = p = checked(replace(self.parameters, **changes), "controller")
        self.checks.parameters = p
        self.law.set_limits(p)
        self.supervisor.set_limits(p)
        self._command.set_speeds(p.max_speed, p.max_angular_speed)
        try:
            if self.law.setpoint is not None:
                self.checks.check_size(self.law.setpoint.wrench)
            elif self.supervisor.displacement is not None and self.law.measured is not None:
                self.checks.check_displacement_load(self.supervisor.displacement, self.law.measured.X_WT[:3, :3])
        except SetpointError as error:
            self.hold(t, f"the limits were lowered: {error}")

    def set_stiffness(self, stiffness: Stiffness, t: float) -> None:
        """Use another stiffness, blended in over `stiffness_blend` so that the arm does not jump.

        A set-point that cannot be followed with it, nor with a quarter more, ends in a hold; for a displacement, whose
        load grows with the stiffness, a quarter less.
        """
        blend = self.parameters.stiffness_blend if self._guard.enabled else 0.0
        law, displacement, estimate = self.law, self.supervisor.displacement, self._inputs.estimate
        doubted = stiffness.scaled(DOUBTED if displacement is None else 1.0 / DOUBTED)
        m, bushing = law.measured, Bushing(doubted, self.wrench_estimator.bushing.model)
        ratio = stiffness.vector() / self.wrench_estimator.bushing.stiffness.vector()
        if not self.wrench_estimator.set_stiffness(stiffness, t, blend):
            return
        if np.abs(ratio - 1.0).max() > ANOTHER:
            self.supervisor.references.new_stiffness()
        if m is None or estimate is None:
            return
        try:
            if law.setpoint is not None:
                self.checks.check_load(law.setpoint, estimate, m.X_WC[:3, :3], bushing)
            elif displacement is not None:
                self.checks.check_displacement_load(displacement, m.X_WT[:3, :3], bushing)
        except SetpointError as error:
            self.hold(t, f"the stiffness was changed: {error}")

    def set_setpoint(self, setpoint: Setpoint, t: float) -> None:
        """Follow a set-point from now on; the latest wins.

        Raises:
            SetpointError: with the number of the refusal. The former set-point and the motion stay as they were.
        """
        try:
            self._adopt(setpoint, t)
        except SetpointError as error:
            self._events.count("setpoints_refused", str(error))
            raise
        self._events.used("setpoints")
        self._setpoint = setpoint

    def _adopt(self, setpoint: Setpoint, t: float) -> None:
        if not self._guard.following:
            why = f"holding: {self._guard.held}" if self._guard.held else "disabled"
            raise SetpointError("SP17", f"the controller is {why}; enable it first")
        checks, law, m, estimate = self.checks, self.law, self.law.measured, self._inputs.estimate
        assert m is not None  # it is enabled with an estimate only
        assert estimate is not None
        checks.check_stamp(setpoint.stamp, t)
        if isinstance(setpoint, RelativePoseSetpoint):
            checks.check_displacement(setpoint, estimate, m.X_WT[:3, :3])
            law.release()
            self.supervisor.follow_displacement(setpoint)
            return
        streamed = isinstance(setpoint, WrenchSetpoint) and isinstance(self._setpoint, WrenchSetpoint)
        hybrid = checks.as_hybrid(setpoint, m, law.setpoint if streamed else None)
        if hybrid.differs_in_place_only(law.setpoint):
            assert law.setpoint is not None
            if not np.array_equal(hybrid.R_W_task, law.setpoint.R_W_task):  # the force turns with it
                checks.check_load(hybrid, estimate, m.X_WC[:3, :3])
            checks.check_place(hybrid.X_W_tip)
            law.move(hybrid)
            return
        checks.check_load(hybrid, estimate, m.X_WC[:3, :3])
        checks.check_place(hybrid.X_W_tip)
        self.supervisor.follow_displacement(None)
        law.adopt(hybrid, self._command.p_WC)
        self._command.turn_to(law.plan.X_WC[:3, :3])

    def step(self, t: float) -> ControlOutput:
        """One control step at time t [s]."""
        dt = 1.0 / self.parameters.rate if self._now == -inf else min(max(t - self._now, 1e-4), 0.05)
        before, self._now = self._now, t
        if set_back := self._inputs.set_back(t, before):
            self._guard.hold(set_back)
            self.supervisor.stamps.restart()
            self.checks.stamp_problem = ""
        if not self._command.started:
            if not len(self._inputs.history):
                self._state = self._describe(t)
                return ControlOutput(None, self._state)
            self._command.start_from(self._inputs.history.newest())
        self._take_image(t)
        self.wrench_estimator.advance(t)
        self.supervisor.check_clocks(self.checks.clock_problem)
        self.supervisor.check_motion(t, self._step)
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
        age = t - estimate.stamp
        self.law.image(m, loop_time=min(age + 0.5 * frame + self._command.lead, 0.5), age=min(age, 0.5))
        if self.law.setpoint is not None:
            self._command.turn_to(self.law.plan.X_WC[:3, :3])
        self.supervisor.image(m, t)

    def _move(self, t: float, dt: float) -> tuple[str, ...]:
        """Move the command on; returns the names of the limits that it met."""
        command, law, setpoint, m = self._command, self.law, self._setpoint, self.law.measured
        if not self._guard.following or setpoint is None or m is None:
            back = self.supervisor.retreat(command.p_WC)
            if back is None:
                command.stop(dt)
            else:
                p = self.parameters
                slow = self.supervisor.doubtful or not law.plan.wanted.any()
                command.give_way(back, dt, p.approach_speed if slow else p.max_speed)
            return ()
        command.compare(self._inputs.history.newest(), dt)
        met: tuple[str, ...] = ()
        if isinstance(setpoint, RelativePoseSetpoint):
            X_WC = gripper_pose(law.tool.X_WT, setpoint.X_TC)
            command.turn_to(X_WC[:3, :3])
            p_WC, speed, known = as_vector3(X_WC[:3, 3]), self.parameters.approach_speed, AT_REST
        else:
            lead = command.lead
            p_WC = law.reference.target(dt, lead, lead + t - m.stamp + 0.02, command.p_WC)
            speed, met, known = self.parameters.max_speed, law.plan.limits, law.reference.known
        if not command.accepts(p_WC):
            self._guard.hold(
                "the control law came to a target that is no number; a recording of this run helps to mend it"
            )
            command.stop(dt)
            return ()
        return met + command.towards(p_WC, dt, speed, known)

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

    def _describe(self, t: float, limits: tuple[str, ...] = ()) -> ControllerState:
        return describe(t, self._setpoint, limits, self.law, self.supervisor, self._events)
