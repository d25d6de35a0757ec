# SPDX-License-Identifier: Apache-2.0
"""The controller: Algorithm 2 and hybrid control in a loop that knows when to stop.

Inputs come with their own stamps, time comes as an argument, and nothing moves before `enable`. When the estimate or
the kinematics go stale or invalid it decelerates to a hold, latched with the reason, until it is enabled again.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from seed_control import admission
from seed_control.features import LAWS
from seed_control.history import PoseHistory
from seed_control.hybrid_law import HybridLaw
from seed_control.lag import LagEstimate
from seed_control.limits import PoseLimiter, VectorLimiter
from seed_control.measurement import Gauge, Measurement
from seed_control.parameters import ControllerParameters
from seed_control.setpoints import (
    HybridSetpoint,
    RelativePoseSetpoint,
    Setpoint,
    SetpointError,
    WrenchSetpoint,
)
from seed_control.state import ControllerState, ControlOutput, Counters, Mode
from seed_control.vectors import Triple, minus, placed, plus, triple, turned
from seed_core.bushing import Bushing, BushingError, Stiffness
from seed_core.config import checked
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import Array, Wrench, check_pose, inverse_pose, rpy_from_rotation

__all__ = ["ControlOutput", "ControlRefusedError", "Controller", "ControllerParameters", "ControllerState"]

BANDWIDTH = 80.0  # [rad/s] of the command's smoothing; it trails by 2 / BANDWIDTH in steady motion
KINDS = {WrenchSetpoint: "wrench", RelativePoseSetpoint: "relative_pose", HybridSetpoint: "hybrid"}


class ControlRefusedError(SeedError):
    """A request that does not fit the controller's present state."""


class Controller:
    """One hand, one tool, one arm. Feed it, call `step` at the control rate, send `X_WE` to the arm."""

    def __init__(self, parameters: ControllerParameters, hand: Hand, tool: Tool, stiffness: Stiffness) -> None:
        self.parameters = p = checked(parameters, "controller")
        self.hand, self.tool, self.stiffness = hand, tool, stiffness
        self.features = LAWS[p.law]
        self._X_EC = hand.X_EC
        self._X_CE = inverse_pose(self._X_EC)
        self._p_EC, self._p_CE = triple(self._X_EC[:3, 3]), triple(self._X_CE[:3, 3])
        self._X_tipE = inverse_pose(tool.X_Ttip) @ self._X_CE
        self._blend: tuple[Stiffness, Stiffness, float] | None = None
        self.gauge = Gauge(tool, self._bushing(stiffness), self.features.gravity, 1e-3 * p.position_noise)
        self.law = HybridLaw(self.features, p, self.gauge)
        self._history = PoseHistory()
        # The gripper's frame C is what moves smoothly: limiting flange position and rotation apart would swing C.
        self._limiter = PoseLimiter(
            VectorLimiter(p.max_speed, p.max_acceleration, p.max_jerk, BANDWIDTH),
            VectorLimiter(p.max_angular_speed, p.max_angular_acceleration, p.max_angular_jerk, BANDWIDTH),
        )
        self._lag = LagEstimate(p.servo_lag)
        self._pending: RelativePoseEstimate | None = None
        self._estimate: RelativePoseEstimate | None = None
        self._measured: Measurement | None = None
        self._setpoint: Setpoint | None = None
        self._relative: RelativePoseSetpoint | None = None
        self._enabled = False
        self._held = ""
        self._note = "not enabled yet"
        self._started = False  # whether the limiter holds a pose of this arm
        self._now = -inf
        self._arrived = -inf  # when the newest usable estimate was taken in
        self._free_from: Triple | None = None  # commanded position at which the approach without contact began
        self._too_far = 0
        self._bad_in_a_row = 0
        self.counters = Counters()
        self._state: ControllerState | None = None

    # --- inputs ------------------------------------------------------------------------------------------------
    def add_kinematics(self, stamp: float, X_WE: Array) -> bool:
        """Flange pose X_WE (4, 4) at stamp [s]. False (counted) when it is no pose or its stamp does not rise."""
        try:
            good = bool(np.isfinite(stamp)) and self._history.add(stamp, check_pose(X_WE, "X_WE"))
        except SeedError as error:
            self._note, good = str(error), False
        if not good:
            self._count("kinematics_refused")
        return good

    def add_estimate(self, estimate: RelativePoseEstimate) -> bool:
        """A new relative pose. False (counted) when it is invalid, older than the last one, or no pose."""
        if not np.isfinite(estimate.stamp):
            return self._bad_estimate("estimate's stamp is not finite")
        if self._estimate is not None and estimate.stamp <= self._estimate.stamp:
            self._count("estimates_out_of_order")
            return False
        if not estimate.valid or estimate.gross_slip:
            why = "the tool has slid in the grasp" if estimate.gross_slip else estimate.reason or "no reason given"
            return self._bad_estimate(f"estimate is invalid: {why}")
        try:
            check_pose(estimate.X_CT, "X_CT")
        except SeedError as error:
            return self._bad_estimate(str(error))
        self._estimate = self._pending = estimate
        self._bad_in_a_row = 0
        return True

    def _bad_estimate(self, why: str) -> bool:
        self._count("estimates_invalid")
        self._bad_in_a_row += 1
        self._note = why
        if self._bad_in_a_row >= 3:  # a single bad frame is bridged, as a lost one is
            self._hold(why)
        return False

    def set_setpoint(self, setpoint: Setpoint, t: float) -> None:
        """Follow a set-point from now on; the latest wins.

        Raises:
            SetpointError: with the number of the refusal. The former set-point and the motion stay as they were.
        """
        try:
            self._adopt(setpoint, t)
        except SetpointError as error:
            self._count("setpoints_refused")
            self._note = str(error)
            raise

    def enable(self, t: float) -> None:
        """Allow motion, from where the arm is; also clears a hold.

        Raises:
            ControlRefusedError: the kinematics or the estimate is missing or stale.
        """
        if t - self._history.newest_stamp > self.parameters.kinematics_timeout:
            raise ControlRefusedError("cannot enable: no flange pose (current_pose) within the last 0.1 s")
        self._digest(t)
        if not self._fresh(t):
            raise ControlRefusedError(
                f"cannot enable: {self._staleness(t) or 'no valid estimate of the relative pose'}"
            )
        if self._enabled and not self._held:
            return
        self._start_from_here()
        self._enabled, self._held, self._note, self._bad_in_a_row = True, "", "", 0
        self._free_from = None
        self._setpoint = self._relative = None
        self.law.release()

    def disable(self, t: float, reason: str) -> None:  # noqa: ARG002 - the same shape as enable
        """Decelerate to rest and ignore set-points until enabled again."""
        self._enabled, self._held, self._note = False, "", reason or "disabled"
        self._setpoint = self._relative = None
        self.law.release()

    def set_stiffness(self, stiffness: Stiffness, t: float) -> None:
        """Use another stiffness, blended in over `stiffness_blend` so that the arm does not jump."""
        if self.parameters.stiffness_blend == 0.0 or not self._enabled:
            self._blend, self.stiffness = None, stiffness
            self.gauge.use(self._bushing(stiffness))
        else:
            self._blend = (self.gauge.bushing.stiffness, stiffness, t)
            self.stiffness = stiffness

    # --- the step ----------------------------------------------------------------------------------------------
    def step(self, t: float) -> ControlOutput:
        """One control step at time t [s]."""
        dt = 1.0 / self.parameters.rate if self._now == -inf else min(max(t - self._now, 1e-4), 0.05)
        self._now = t
        if not len(self._history):
            return ControlOutput(None, self._describe(t, ()))
        if not self._started:
            self._start_from_here()
        self._digest(t)
        if self._blend is not None:
            self._advance_blend(t)
        if self._enabled and not self._held:
            self._watch(t)
        limits = self._move(t, dt)
        return ControlOutput(self._limiter.pose @ self._X_CE, self._describe(t, limits))

    @property
    def state(self) -> ControllerState:
        """The state after the last step."""
        return self._state if self._state is not None else self._describe(self._now, ())

    def _move(self, t: float, dt: float) -> tuple[str, ...]:
        limiter, p = self._limiter, self.parameters
        if not self._enabled or self._held or self._setpoint is None or self._measured is None:
            limiter.stop(dt)
            return ()
        self._lag.update(limiter.p, placed(self._history.newest().tolist(), self._p_EC), limiter.linear.v, dt)
        if self._relative is not None:
            p_WC, R_WC = self._relative_target(self._relative)
        else:
            lead = self._lead()
            p_WC = self.law.target(dt, lead, lead + t - self._measured.stamp + 0.02)
            R_WC = self.law.R_WC
        limits = self.law.limits if self._relative is None else ()
        p_WE = plus(p_WC, turned(R_WC.tolist(), self._p_CE))
        if not self._inside(p_WE):
            limits += ("workspace",)
            p_WC = triple(np.array(p_WC) + np.clip(p_WE, p.workspace_low, p.workspace_high) - p_WE)
        limiter.advance(p_WC, R_WC, dt, p.approach_speed if self._relative is not None else p.max_speed)
        if limiter.linear.limited:
            limits += ("max_speed",)
        if limiter.angular.limited:
            limits += ("max_angular_speed",)
        return limits

    def _inside(self, p_WE: Triple) -> bool:
        (x, y, z), (a, b, c), (d, e, f) = p_WE, self.parameters.workspace_low, self.parameters.workspace_high
        return a <= x <= d and b <= y <= e and c <= z <= f

    def _lead(self) -> float:
        """By how long the arm trails what the law asks for [s]: its own lag, and the smoothing of the command."""
        return self._lag.lag + 2.0 / BANDWIDTH

    def _relative_target(self, setpoint: RelativePoseSetpoint) -> tuple[Triple, Array]:
        tool, X_TC = self.law.tool, setpoint.X_TC
        p_TC = X_TC[:3, 3] - self.gauge.p_Ttip  # from the tip
        return triple(tool.tip + tool.R_WT @ p_TC), tool.R_WT @ X_TC[:3, :3]

    # --- estimates ---------------------------------------------------------------------------------------------
    def _digest(self, t: float) -> None:
        """Match the newest estimate with the kinematics of its moment; it waits while those are still to come."""
        estimate = self._pending
        if estimate is None:
            return
        stamp = estimate.stamp
        X_WE = self._history.at(stamp) if self.features.synchronise else self._history.newest()
        if X_WE is None:
            if stamp < self._history.oldest_stamp or t - stamp > self.parameters.max_estimate_age:
                self._pending = None
                self._count("estimates_unmatched")
                self._note = f"estimate of {t - stamp:.3f} s ago meets no kinematics of its moment"
            return
        self._pending = None
        self._arrived = t
        frame = stamp - self._measured.stamp if self._measured is not None else 0.0
        self.law.loop_time = min(t - stamp + 0.5 * frame + self._lead(), 0.5)
        self._measured = m = self.gauge.measure(estimate, X_WE @ self._X_EC)
        self.law.image(m)
        self.counters = self.counters._replace(contacts_lost=self.law.touch.lost)
        self._check_measured(m)

    def _check_measured(self, m: Measurement) -> None:
        """Hold when the grasp is deflected or loaded beyond what it endures, in three images in a row."""
        p = self.parameters
        force = float(np.sqrt(m.on_environment.force @ m.on_environment.force))
        deflection = float(np.sqrt(m.X_TC[:3, 3] @ m.X_TC[:3, 3]))
        angle = float(np.rad2deg(np.abs(rpy_from_rotation(m.X_TC[:3, :3])).max()))
        over = (
            f"estimated force {force:.1f} N is beyond {p.max_measured_force:g} N"
            if force > p.max_measured_force
            else f"deflection {1e3 * deflection:.1f} mm is beyond {1.2e3 * p.max_deflection:.1f} mm: the tool may slip"
            if deflection > 1.2 * p.max_deflection
            else f"rotation {angle:.0f} degrees in the grasp is beyond {1.2 * p.max_rotation:.0f}: the tool may slip"
            if angle > 1.2 * p.max_rotation
            else ""
        )
        self._too_far = self._too_far + 1 if over else 0
        if self._too_far >= 3 and self._enabled:
            self._hold(over)

    def _fresh(self, t: float) -> bool:
        return self._measured is not None and not self._staleness(t)

    def _staleness(self, t: float) -> str:
        """Why the inputs must not be used any more; empty while they may."""
        p, newest = self.parameters, self._history.newest_stamp
        if t - newest > p.kinematics_timeout:
            return f"current_pose is stale: {t - newest:.3f} s old, at most {p.kinematics_timeout:g} s"
        if self._measured is None:
            return "no estimate of the relative pose has come yet"
        if t - self._arrived > p.estimate_timeout:
            return f"relative_pose is stale: none for {t - self._arrived:.3f} s, at most {p.estimate_timeout:g} s"
        if t - self._measured.stamp > p.max_estimate_age:
            return f"relative_pose is stale: {t - self._measured.stamp:.3f} s old, at most {p.max_estimate_age:g} s"
        return ""

    # --- watching ----------------------------------------------------------------------------------------------
    def _watch(self, t: float) -> None:
        why = self._staleness(t)
        if why:
            self._hold(why)
            return
        if self._setpoint is None or self._relative is not None or self.law.contact or not self.law.regulates_force:
            self._free_from = None
        elif self._free_from is None:
            self._free_from = self._limiter.p
        else:
            travel = self.law.normals @ minus(self._limiter.p, self._free_from)
            far = float(np.sqrt(travel @ travel))
            if far > self.parameters.max_free_travel:
                self._hold(
                    f"no contact within max_free_travel = {1e3 * self.parameters.max_free_travel:.0f} mm: "
                    "start nearer to the surface, or check the estimate"
                )

    def _hold(self, why: str) -> None:
        self._note = why
        if self._enabled and not self._held:
            self._held = why
            self._count("holds")

    def _start_from_here(self) -> None:
        """The command starts at the arm's pose; a command that already rests there stays, so nothing moves."""
        here = self._history.newest() @ self._X_EC
        at_rest = self._started and float(np.abs(self._limiter.pose - here).max()) < 2e-3
        if not at_rest:
            self._limiter.reset(here)
        self._started = True

    # --- set-points --------------------------------------------------------------------------------------------
    def _adopt(self, setpoint: Setpoint, t: float) -> None:
        if not self._enabled or self._held:
            raise SetpointError(
                "SP17", f"the controller is {'holding: ' + self._held if self._held else 'disabled'}; enable it first"
            )
        admission.check_stamp(setpoint.stamp, t, self.parameters.setpoint_max_age)
        if isinstance(setpoint, RelativePoseSetpoint):
            X = setpoint.X_TC
            admission.check_deflection(X[:3, 3], rpy_from_rotation(X[:3, :3]), self.parameters)
            self._relative, self._setpoint = setpoint, setpoint
            self.law.release()
            return
        hybrid = self._as_hybrid(setpoint) if isinstance(setpoint, WrenchSetpoint) else setpoint
        anew = self._changed(hybrid)
        if anew:
            self._check(hybrid)
        self._check_place(hybrid)
        self._setpoint, self._relative = setpoint, None
        if anew:
            self.law.adopt(hybrid, self._limiter.p)
        else:
            self.law.setpoint = hybrid

    def _as_hybrid(self, s: WrenchSetpoint) -> HybridSetpoint:
        """Algorithm 2 alone: every direction carries force; angles are torque where a contact resists them."""
        m = self._measured
        assert m is not None
        X_W_tip = m.X_WT @ self.tool.X_Ttip
        if any(s.contact_resists) != all(s.contact_resists):
            raise SetpointError(
                "SP09",
                "a wrench set-point needs contact_resists about all three axes or none; use a "
                "hybrid set-point for some of them",
            )
        return HybridSetpoint(
            X_W_tip=X_W_tip,
            wrench=s.wrench,
            force_projector=np.eye(3),
            torque_axes=s.contact_resists,
            task_frame=s.frame,
            contact_resists=s.contact_resists,
        )

    def _changed(self, s: HybridSetpoint) -> bool:
        """Whether more than the place has changed since the last set-point, so that it must be judged anew."""
        old = self.law.setpoint
        if old is None:
            return True
        if old.wrench is s.wrench and old.force_projector is s.force_projector and old.R_W_task is s.R_W_task:
            return not np.array_equal(old.X_W_tip[:3, :3], s.X_W_tip[:3, :3])  # one moved from the other
        return not (
            old.task_frame == s.task_frame
            and old.torque_axes == s.torque_axes
            and old.approach_speed == s.approach_speed
            and np.array_equal(old.wrench.force, s.wrench.force)
            and np.array_equal(old.wrench.torque, s.wrench.torque)
            and np.array_equal(old.force_projector, s.force_projector)
            and np.array_equal(old.R_W_task, s.R_W_task)
            and np.array_equal(old.X_W_tip[:3, :3], s.X_W_tip[:3, :3])
        )

    def _check(self, s: HybridSetpoint) -> None:
        p, m = self.parameters, self._measured
        assert m is not None
        assert self._estimate is not None
        admission.check_load(s.wrench, p)
        R_WT = s.X_W_tip[:3, :3] @ self.law.R_tipT
        R_W_task = s.X_W_tip[:3, :3] if s.task_frame == "tool" else s.R_W_task
        torque_T = R_WT.T @ R_W_task @ s.wrench.torque
        admission.check_torque_axes(s, torque_T)
        force_T = R_WT.T @ R_W_task @ s.wrench.force
        load = Wrench(torque_T, force_T).about(-self.gauge.p_Ttip).minus(self.gauge.weight(R_WT))
        try:
            X_TC = self.gauge.bushing.pose(load)
        except BushingError as error:
            raise SetpointError("SP13", str(error)) from error
        admission.check_deflection(X_TC[:3, 3], rpy_from_rotation(X_TC[:3, :3]), p)
        admission.check_tipping(
            force_T, self.gauge.p_Ttip, s.torque_axes, self.gauge.bushing.stiffness, p.tipping_margin
        )
        P = R_W_task @ s.force_projector @ R_W_task.T
        directions = np.array([v for v in P if v @ v > 0.1])
        admission.check_observed(directions, s.torque_axes, self._estimate.observed, m.X_WC[:3, :3])

    def _check_place(self, s: HybridSetpoint) -> None:
        X_WE = s.X_W_tip @ self._X_tipE  # of an undeflected grasp
        admission.check_workspace(X_WE[:3, 3], self.parameters)

    # --- odds and ends -----------------------------------------------------------------------------------------
    def _bushing(self, stiffness: Stiffness) -> Bushing:
        return Bushing(stiffness, self.features.model)

    def _advance_blend(self, t: float) -> None:
        assert self._blend is not None
        old, new, start = self._blend
        share = min(max((t - start) / self.parameters.stiffness_blend, 0.0), 1.0)
        mix = [
            (1 - share) * a + share * b
            for a, b in zip(old.rotation + old.translation, new.rotation + new.translation, strict=True)
        ]
        self.gauge.use(self._bushing(Stiffness((mix[0], mix[1], mix[2]), (mix[3], mix[4], mix[5]))))
        if share >= 1.0:
            self._blend = None

    def _count(self, name: str) -> None:
        self.counters = self.counters._replace(**{name: getattr(self.counters, name) + 1})

    def _mode(self) -> Mode:
        if not self._enabled:
            return "disabled"
        if self._held:
            return "holding"
        if self._setpoint is None:
            return "idle"
        if self._relative is not None or not self.law.regulates_force:
            return "position"
        return "contact" if self.law.contact else "approach"

    def _describe(self, t: float, limits: tuple[str, ...]) -> ControllerState:
        m, law, s, mode = self._measured, self.law, self.law.setpoint, self._mode()
        self._state = ControllerState(
            t,
            mode,
            self._enabled,
            KINDS[type(self._setpoint)] if self._setpoint is not None else "",
            s.wrench if s is not None else None,
            law.estimated_task,
            law.filtered_task,
            law.X_TC_wanted if s is not None else self._relative.X_TC if self._relative else None,
            m.X_CT if m is not None else None,
            law.X_W_tip,
            law.R_W_task,
            limits,
            self._held or self._note,
            law.contact,
            mode == "contact" and law.settled,
            t - m.stamp if m is not None else inf,
            self.counters,
        )
        return self._state


def with_law(parameters: ControllerParameters, law: str) -> ControllerParameters:
    """The same parameters for another law."""
    return checked(replace(parameters, law=law), "controller")
