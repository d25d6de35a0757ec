# SPDX-License-Identifier: Apache-2.0
"""The controller: Algorithm 2 and hybrid control in a loop that knows when to stop.

Inputs come with their own stamps, time comes as an argument, and nothing moves before `enable`. When the estimate or
the kinematics go stale or invalid it decelerates to a hold, latched with the reason, until it is enabled again.
"""

from __future__ import annotations

from math import inf

from seed_control.command.flange_command import Command
from seed_control.command.guard import Guard
from seed_control.law.features import LAWS
from seed_control.law.hybrid import HybridLaw
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.acceptance import Acceptance
from seed_control.setpoint.checks import check_stamp, unobserved_displacement, unobserved_load
from seed_control.setpoint.setpoints import (
    HybridSetpoint,
    RelativePoseSetpoint,
    Setpoint,
    SetpointError,
    WrenchSetpoint,
)
from seed_control.state import ControllerState, ControlOutput, Journal, Mode
from seed_control.wrench.estimate import Gauge, Measurement
from seed_control.wrench.inputs import MOST_BAD, Inputs
from seed_core.bushing import Bushing, Stiffness
from seed_core.config import checked
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import Array
from seed_core.vector3 import Vector3, as_vector3

__all__ = ["ControlOutput", "ControlRefusedError", "Controller", "ControllerParameters", "ControllerState"]

KINDS = {WrenchSetpoint: "wrench", RelativePoseSetpoint: "relative_pose", HybridSetpoint: "hybrid", type(None): ""}


class ControlRefusedError(SeedError):
    """A request that does not fit the controller's present state."""


class Controller:
    """One hand, one tool, one arm. Feed it, call `step` at the control rate, send `X_WE` to the arm."""

    def __init__(self, parameters: ControllerParameters, hand: Hand, tool: Tool, stiffness: Stiffness) -> None:
        self.parameters = p = checked(parameters, "controller")
        self.hand, self.tool, self.stiffness = hand, tool, stiffness
        features = LAWS[p.law]
        bushing = Bushing(stiffness, features.model)
        self._X_EC = hand.X_EC
        self.gauge = Gauge(tool, bushing, features.gravity, 1e-3 * p.position_noise)
        self.law = HybridLaw(features, p, self.gauge)
        self.journal = Journal("not enabled yet")
        self._inputs = Inputs(p, features.synchronise, self.journal)
        self._acceptance = Acceptance(p, self.gauge, hand, tool)
        self._guard = Guard(p)
        self._command = Command(p, hand.X_EC)
        self._measured: Measurement | None = None
        self._setpoint: Setpoint | None = None
        self._enabled = False
        self._held = ""
        self._now = -inf
        self._state: ControllerState | None = None

    # --- inputs ------------------------------------------------------------------------------------------------
    def add_kinematics(self, stamp: float, X_WE: Array) -> bool:
        """Flange pose X_WE (4, 4) at stamp [s]. False (counted) when it is no pose or its stamp does not rise."""
        return self._inputs.add_kinematics(stamp, X_WE)

    def add_estimate(self, estimate: RelativePoseEstimate) -> bool:
        """A new relative pose. False (counted) when it is invalid, older than the last one, or no pose.

        While force, torque or a displacement is controlled on an axis that it does not observe, it counts as invalid.
        """
        good = self._inputs.add_estimate(estimate, self._blind(estimate))
        if self._inputs.bad_in_a_row >= MOST_BAD:
            self._hold(self.journal.note)
        return good

    def set_setpoint(self, setpoint: Setpoint, t: float) -> None:
        """Follow a set-point from now on; the latest wins.

        Raises:
            SetpointError: with the number of the refusal. The former set-point and the motion stay as they were.
        """
        try:
            self._adopt(setpoint, t)
        except SetpointError as error:
            self.journal.count("setpoints_refused", str(error))
            raise

    def enable(self, t: float) -> None:
        """Allow motion, from where the arm is; also clears a hold.

        Raises:
            ControlRefusedError: the kinematics or the estimate is missing or stale.
        """
        if t - self._inputs.history.newest_stamp > self.parameters.kinematics_timeout:
            raise ControlRefusedError("cannot enable: no flange pose (current_pose) within the last 0.1 s")
        self._digest(t)
        stale = self._inputs.staleness(t)
        if stale:
            raise ControlRefusedError(f"cannot enable: {stale}")
        if self._enabled and not self._held:
            return
        self._command.start_from(self._inputs.history.newest())
        self._release()
        self._enabled, self._held, self.journal.note, self._inputs.bad_in_a_row = True, "", "", 0

    def disable(self, t: float, reason: str) -> None:
        """Decelerate to rest and ignore set-points until enabled again."""
        self._release()
        self._enabled, self._held, self.journal.note = False, "", reason or "disabled"
        self._describe(t, ())  # whoever plays something sees it at once

    def set_stiffness(self, stiffness: Stiffness, t: float) -> None:
        """Use another stiffness, blended in over `stiffness_blend` so that the arm does not jump."""
        self.stiffness = stiffness
        self.gauge.change(stiffness, t, self.parameters.stiffness_blend if self._enabled else 0.0)

    # --- the step ----------------------------------------------------------------------------------------------
    def step(self, t: float) -> ControlOutput:
        """One control step at time t [s]."""
        dt = 1.0 / self.parameters.rate if self._now == -inf else min(max(t - self._now, 1e-4), 0.05)
        self._now = t
        if not self._command.started:
            if not len(self._inputs.history):
                return ControlOutput(None, self._describe(t, ()))
            self._command.start_from(self._inputs.history.newest())
        if self._inputs.pending is not None:
            self._digest(t)
        self.gauge.advance(t)
        if self._enabled and not self._held:
            self._watch(t)
        limits = self._move(t, dt)
        return ControlOutput(self._command.X_WE, self._describe(t, limits))

    @property
    def state(self) -> ControllerState:
        """The state after the last step."""
        return self._state if self._state is not None else self._describe(self._now, ())

    def _move(self, t: float, dt: float) -> tuple[str, ...]:
        """Move the command on; returns the names of the limits that it met."""
        command, hybrid, m = self._command, self.law.setpoint, self._measured
        if not self._enabled or self._held or self._setpoint is None or m is None:
            command.stop(dt)
            return ()
        command.compare(self._inputs.history.newest(), dt)
        if hybrid is None:
            return command.towards(self._relative_target(), dt, self.parameters.approach_speed)
        lead = command.lead
        p_WC = self.law.walk.target(hybrid, dt, lead, lead + t - m.stamp + 0.02)
        return self.law.limits + command.towards(p_WC, dt, self.parameters.max_speed)

    def _relative_target(self) -> Vector3:
        assert isinstance(self._setpoint, RelativePoseSetpoint)  # all others the law follows
        tool, X_TC = self.law.tool, self._setpoint.X_TC
        self._command.turn_to(tool.R_WT @ X_TC[:3, :3])
        return as_vector3(tool.tip + tool.R_WT @ (X_TC[:3, 3] - self.gauge.p_Ttip))  # from the tip

    def _digest(self, t: float) -> None:
        """Take in the newest estimate, once the kinematics of its moment are there."""
        matched = self._inputs.match(t)
        if matched is None:
            return
        estimate, X_WE = matched
        frame = estimate.stamp - self._measured.stamp if self._measured is not None else 0.0
        self.law.loop_time = min(t - estimate.stamp + 0.5 * frame + self._command.lead, 0.5)
        self._measured = m = self.gauge.measure(estimate, X_WE @ self._X_EC)
        self.law.image(m)
        self._command.turn_to(self.law.R_WC)
        self.journal.counters = self.journal.counters._replace(contacts_lost=self.law.touch.lost)
        why = self._guard.overload(m)
        if why and self._enabled:
            self._hold(why)

    def _watch(self, t: float) -> None:
        """Hold when the inputs go stale, or contact is sought for too far."""
        why = self._inputs.staleness(t)
        if not why:
            law = self.law
            if law.setpoint is None or law.contact or not law.regulates_force:
                self._guard.arrived()
            else:
                why = self._guard.free_travel(self._command.p_WC, law.normals)
        if why:
            self._hold(why)

    def _blind(self, estimate: RelativePoseEstimate) -> str:
        """What the set-point controls that the estimate does not observe: it would count as undeflected."""
        if all(estimate.observed) or self._setpoint is None or self._held:
            return ""
        if isinstance(self._setpoint, RelativePoseSetpoint):
            return unobserved_displacement(self._setpoint.X_TC, estimate)
        law, m = self.law, self._measured
        assert m is not None  # it is enabled with an estimate only
        assert law.setpoint is not None
        return unobserved_load(law.normals, law.setpoint.torque_axes, estimate, m.X_WC[:3, :3])

    def _hold(self, why: str) -> None:
        self.journal.note = why
        if self._enabled and not self._held:
            self._held = why
            self.journal.count("holds")

    def _release(self) -> None:
        """Follow nothing."""
        self._setpoint = None
        self._guard.arrived()
        self.law.release()

    # --- set-points --------------------------------------------------------------------------------------------
    def _adopt(self, setpoint: Setpoint, t: float) -> None:
        if not self._enabled or self._held:
            raise SetpointError(
                "SP17", f"the controller is {'holding: ' + self._held if self._held else 'disabled'}; enable it first"
            )
        check_stamp(setpoint.stamp, t, self.parameters.setpoint_max_age)
        m, estimate = self._measured, self._inputs.estimate
        assert m is not None  # it is enabled with an estimate only
        assert estimate is not None
        if isinstance(setpoint, RelativePoseSetpoint):
            self._acceptance.displacement(setpoint, estimate)
            self._setpoint = setpoint
            self.law.release()
            return
        hybrid, moved = self._acceptance.hybrid(setpoint, self.law.setpoint, m, estimate)
        self._setpoint = setpoint
        if moved:
            self.law.setpoint = hybrid
        else:
            self.law.adopt(hybrid, self._command.p_WC)
            self._command.turn_to(self.law.R_WC)

    # --- what it tells -----------------------------------------------------------------------------------------
    def _mode(self) -> Mode:
        if not self._enabled:
            return "disabled"
        if self._held:
            return "holding"
        if self._setpoint is None:
            return "idle"
        if not self.law.regulates_force:  # nor does a relative pose
            return "position"
        return "contact" if self.law.contact else "approach"

    def _describe(self, t: float, limits: tuple[str, ...]) -> ControllerState:
        m, law, mode, asked, hybrid = self._measured, self.law, self._mode(), self._setpoint, self.law.setpoint
        self._state = ControllerState(
            t,
            mode,
            self._enabled,
            KINDS[type(asked)],
            hybrid.wrench if hybrid is not None else None,
            law.estimated_task,
            law.filtered_task,
            law.X_TC_wanted if hybrid is not None else asked.X_TC if isinstance(asked, RelativePoseSetpoint) else None,
            m.X_CT if m is not None else None,
            law.X_W_tip,
            law.R_W_task,
            limits,
            self._held or self.journal.note,
            law.contact,
            mode == "contact" and law.settled,
            t - m.stamp if m is not None else inf,
            self.journal.counters,
        )
        return self._state
