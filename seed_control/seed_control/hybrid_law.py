# SPDX-License-Identifier: Apache-2.0
"""One control law for force, torque, position and angle at once: from images and a set-point to a gripper pose.

`image` does the geometry at the camera's rate, `target` the little that changes with every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from seed_control.hybrid import PartialInverseError, hybrid_translation, partial_angles
from seed_control.measurement import ROTATION_DEVIATION, Gauge, Measurement
from seed_control.observer import ObserverTuning, SurfaceObserver
from seed_control.parameters import ControllerParameters
from seed_control.setpoints import HybridSetpoint
from seed_core.spatial import Array, Wrench, cross, rotation_from_rpy, rpy_from_rotation, so3_exp, so3_log

_APPROACH_SHARE = 0.7  # of the wanted deflection that an approach may cover before the first image of contact acts
_LEAST_MARGIN = 0.1  # of stiffness against tipping that is still told apart
_PRESS_TIME = 0.1  # [s] in which the force may be built up at the soonest, once the surface is known
_SLOWEST = 1e-3  # [m/s]


@dataclass(frozen=True)
class Features:
    """What distinguishes the laws."""

    synchronise: bool  # kinematics of the image's moment, not of now
    gravity: bool
    model: str
    observer: bool
    filtered: bool  # low-pass of the tool's pose where there is no observer
    feedforward: bool  # the tool, not the gripper, reaches the reference


LAWS = {
    "seed": Features(True, True, "midpoint", True, True, True),
    "plain": Features(True, True, "midpoint", False, True, True),
    "published": Features(False, False, "plain", False, False, False),
}


def share_of(dt: float, tau: float) -> float:
    """Weight of a new sample in a first-order low-pass of time constant tau [s] after dt [s]."""
    return 1.0 - exp(-dt / tau) if tau > 0.0 else 1.0


class HybridLaw:
    """State: the low-passed tool rotation, deflection and load, and an observer per force direction."""

    def __init__(self, features: Features, parameters: ControllerParameters, gauge: Gauge) -> None:
        self.features, self.parameters, self.gauge = features, parameters, gauge
        self.X_Ttip = gauge.tool.X_Ttip
        self.R_tipT = self.X_Ttip[:3, :3].T.copy()
        self.X_W_tip: Array | None = None
        self.estimated_task: Wrench | None = None
        self.filtered_task: Wrench | None = None
        self.settled = False
        self.contact = False
        self.limits: tuple[str, ...] = ()
        self.measured: Measurement | None = None
        self.setpoint: HybridSetpoint | None = None
        self.R_WC = np.eye(3)  # wanted rotation of the gripper
        self.R_W_task = np.eye(3)
        self.X_TC_wanted = np.eye(4)
        self.filtered: Wrench | None = None
        self.normals = np.zeros((0, 3))  # (m, 3) force directions in W
        self.deflections = np.zeros(0)  # (m,) wanted along the normals [m]
        self.observers: list[SurfaceObserver] = []
        self.contacts_lost = 0
        self.loop_time = 0.1  # [s] from an image to the arm's answer, set by whoever knows
        self._seen: list[int] = [0, 0]  # images in a row above and below the thresholds of contact
        self._lever = np.zeros(3)
        self._tipping_gain = 1.0
        self._undeflected = np.zeros(3)  # commanded place of the undeflected tip
        self._position_part = np.eye(3)
        self._wanted = np.zeros(0)  # (m,) force along the normals [N]

    # --- set-point ---------------------------------------------------------------------------------------------
    def adopt(self, setpoint: HybridSetpoint, p_WC: Array) -> None:
        """Follow a set-point from now on; p_WC (3,) is the commanded gripper position, for a start without a jump."""
        before = self.setpoint
        self.setpoint = setpoint
        if self.measured is None:
            return
        same = before is not None and (
            before.task_frame == setpoint.task_frame
            and np.array_equal(before.force_projector, setpoint.force_projector)
        )
        self._task_axes()
        if not same:
            self._new_directions(p_WC)
        self._solve()

    def _task_axes(self) -> None:
        s = self.setpoint
        assert s is not None
        self.R_W_task = self.R_WT @ self.R_tipT.T if s.task_frame == "tool" else s.R_W_task

    def _new_directions(self, p_WC: Array) -> None:
        """Other force directions than before: contact is to be found anew."""
        m = round(float(np.trace(self.setpoint.force_projector))) if self.setpoint else 0
        p = self.parameters
        tuning = ObserverTuning(1e-3 * p.surface_noise, p.slope_noise, 2e-3, p.slope_prior, p.compliance_prior)
        self.observers = [SurfaceObserver(tuning) for _ in range(m)]
        self._undeflected = p_WC + self.R_WT @ self.gauge.p_Ttip
        self.contact = False
        self._seen = [0, 0]

    def release(self) -> None:
        """Follow nothing until the next `adopt`."""
        self.setpoint, self.contact, self.settled = None, False, False
        self.observers, self.normals, self.limits = [], np.zeros((0, 3)), ()
        self.R_W_task = np.eye(3)

    # --- per image ---------------------------------------------------------------------------------------------
    def image(self, m: Measurement) -> None:
        """Take in a new image's measurement and renew what follows from it."""
        self._filter(m)
        self.measured = m
        if self.setpoint is not None:
            self._task_axes()
            self._solve()
            self._judge_contact(m)
            for n, observer in zip(self.normals, self.observers, strict=True):
                if self.contact:
                    observer.update(m.stamp, n, m.tip, m.undeflected, m.variance)
        self._tell(m)

    def _tell(self, m: Measurement) -> None:
        """What the state shows of this image."""
        assert self.filtered is not None
        self.X_W_tip = m.X_WT @ self.X_Ttip
        self.estimated_task = m.on_environment.rotated(self.R_W_task.T)
        self.filtered_task = self.filtered.rotated(self.R_W_task.T)
        error = np.abs(self.normals @ self.filtered.force - self._wanted)
        self.settled = self.contact and bool((error < np.maximum(0.1 * np.abs(self._wanted), 0.3)).all())

    def _filter(self, m: Measurement) -> None:
        q = rpy_from_rotation(m.X_TC[:3, :3])
        offset = m.X_WC[:3, 3] - m.tip
        if self.measured is None:
            self.R_WT, self.q, self.offset = m.X_WT[:3, :3].copy(), q, offset
            self.p_TC, self.spring, self.filtered = m.X_TC[:3, 3].copy(), m.spring, m.on_environment
            self.tip = m.tip.copy()
            return
        dt, p = m.stamp - self.measured.stamp, self.parameters
        R = m.X_WT[:3, :3]
        smoothing = p.rotation_filter * min(m.rotation_deviation / ROTATION_DEVIATION, 1.0)  # as much as the noise asks
        self.R_WT = self.R_WT @ so3_exp(self._share(dt, smoothing) * so3_log(self.R_WT.T @ R))
        slowest = p.feedforward_ratio * self.loop_time
        gain = self._tipping_gain  # of both loops: a tool near tipping gives way to a side force as well
        self.q = self.q + share_of(dt, max(p.angle_feedforward, slowest) * gain) * (q - self.q)
        self.offset = self.offset + share_of(dt, max(p.position_feedforward, slowest) * gain) * (offset - self.offset)
        a = share_of(dt, p.rotation_filter)
        self.p_TC = self.p_TC + a * (m.X_TC[:3, 3] - self.p_TC)
        self.spring = _mixed(self.spring, m.spring, a)
        assert self.filtered is not None
        self.filtered = _mixed(self.filtered, m.on_environment, a)
        self.tip = self.tip + self._share(dt, p.force_filter) * (m.tip - self.tip)

    def _share(self, dt: float, tau: float) -> float:
        return share_of(dt, tau) if self.features.filtered else 1.0

    def _solve(self) -> None:
        """Wanted gripper rotation and deflections from the set-point and the newest filtered measurement."""
        s = self.setpoint
        assert s is not None
        self.limits = ()
        self._lever = self.R_WT @ self.gauge.p_Ttip
        P = self.R_W_task @ s.force_projector @ self.R_W_task.T
        self._position_part = np.eye(3) - P
        self.normals = _directions(P, len(self.observers))
        self._wanted = self.normals @ (self.R_W_task @ s.wrench.force)
        self._tipping_gain = self._gain_of_tipping(s)
        self._solve_rotation(s, P)
        self._solve_translation(s, P)

    def _gain_of_tipping(self, s: HybridSetpoint) -> float:
        """How much further than the gripper a pressed tool turns, 1 / (1 - F H / k) on its weakest held axis.

        The fed-forward deflection is integral action on the tool's angle with this gain in its loop, so the time
        constant grows with it and the loop's speed stays the same.
        """
        force_T = self.R_WT.T @ (self.R_W_task @ s.wrench.force)
        moment = float(force_T @ self.gauge.p_Ttip)
        k = [k for k, on in zip(self.gauge.bushing.stiffness.rotation, s.torque_axes, strict=True) if not on]
        if moment <= 0.0 or not k:
            return 1.0
        return 1.0 / max(1.0 - moment / min(k), _LEAST_MARGIN)

    def _solve_rotation(self, s: HybridSetpoint, P: Array) -> None:
        R_WT_des = s.X_W_tip[:3, :3] @ self.R_tipT
        q = self.q if self.features.feedforward else np.zeros(3)
        self.R_WC = R_WT_des @ rotation_from_rpy(q)
        if not any(s.torque_axes) or not self.contact:
            return
        R_WT = self.R_WT
        angles = rpy_from_rotation(R_WT.T @ self.R_WC)
        torque = self._gimbal_torque(s, P)
        k = self.gauge.bushing.stiffness.rotation
        try:
            wanted = partial_angles(k, _triple(torque), _triple(angles), s.torque_axes, float(angles[1]))
        except PartialInverseError:
            self.limits += ("torque domain",)
            return
        bound = float(np.deg2rad(self.parameters.max_rotation))
        clipped = np.clip(np.array(wanted), -bound, bound)
        if np.any(clipped != wanted):
            self.limits += ("max_rotation",)
        self.R_WC = self._within_drift(R_WT @ rotation_from_rpy(clipped), R_WT_des)

    def _within_drift(self, R_WC: Array, R_WT_des: Array) -> Array:
        bound = float(np.deg2rad(self.parameters.max_drift + self.parameters.max_rotation))
        drift = so3_log(R_WT_des.T @ R_WC)
        size = float(np.sqrt(drift @ drift))
        if size <= bound:
            return R_WC
        self.limits += ("max_drift",)
        return R_WT_des @ so3_exp(drift * (bound / size))

    def _gimbal_torque(self, s: HybridSetpoint, P: Array) -> Array:
        """Torque N^T k q wanted in T: that of the set-point, moved from the tip to T, less weight and coupling."""
        R_WT, gauge = self.R_WT, self.gauge
        assert self.filtered is not None
        wanted = self.R_W_task @ s.wrench.force
        force_T = R_WT.T @ (P @ wanted + self.filtered.force - P @ self.filtered.force)
        torque = R_WT.T @ (self.R_W_task @ s.wrench.torque) + cross(gauge.p_Ttip, force_T)
        torque = torque - gauge.weight(R_WT).torque
        if gauge.bushing.model == "midpoint":
            torque = torque - 0.5 * cross(self.p_TC, self.spring.force)
        return torque

    def _solve_translation(self, s: HybridSetpoint, P: Array) -> None:
        R_WT, gauge = self.R_WT, self.gauge
        R_TC = R_WT.T @ self.R_WC
        K = R_WT @ gauge.bushing.translation_stiffness(R_TC) @ R_WT.T
        force = self.R_W_task @ s.wrench.force - R_WT @ gauge.weight(R_WT).force
        d = hybrid_translation(P, K, R_WT @ self.p_TC, force)
        size, bound = float(np.sqrt(d @ d)), self.parameters.max_deflection
        if size > bound:
            self.limits += ("max_deflection",)
            d = d * (bound / size)
        self.deflections = self.normals @ d
        self.X_TC_wanted = np.eye(4)
        self.X_TC_wanted[:3, :3], self.X_TC_wanted[:3, 3] = R_TC, R_WT.T @ d

    # --- contact -----------------------------------------------------------------------------------------------
    def _judge_contact(self, m: Measurement) -> None:
        """Contact after some images above a share of each wanted force; lost after more of them below another."""
        p = self.parameters
        wanted = self._wanted
        along = (self.normals @ m.on_environment.force) * np.sign(wanted)
        active = np.abs(wanted) > 0.0
        if not active.any():
            return
        noise = 2.5 * self._stiffness_along() * m.variance**0.5
        above = bool(np.any(along[active] > np.maximum(p.contact_share * np.abs(wanted[active]), noise)))
        below = bool(np.all(along[active] < p.lost_share * np.abs(wanted[active])))
        self._seen = [self._seen[0] + 1 if above else 0, self._seen[1] + 1 if below else 0]
        if not self.contact and self._seen[0] >= p.contact_images:
            self._touch(m)
        elif self.contact and self._seen[1] >= p.lost_images:
            self.contact = False
            self.contacts_lost += 1

    def _touch(self, m: Measurement) -> None:
        self.contact = True
        for n, observer in zip(self.normals, self.observers, strict=True):
            observer.start(m.stamp, n, m.tip, m.undeflected)

    def _stiffness_along(self) -> float:
        return float(np.mean(self.gauge.bushing.K))

    # --- per step ----------------------------------------------------------------------------------------------
    def target(self, dt: float, lead: float, loop_time: float) -> Array:
        """Wanted gripper position p_WC (3,) for this step of dt [s].

        Args:
            lead: [s] by which the arm trails its command.
            loop_time: [s] from an image to the arm's answer, which bounds the approach.
        """
        s = self.setpoint
        assert s is not None
        tip_wanted = s.X_W_tip[:3, 3] + lead * s.velocity
        offset = self.offset
        if not self.features.feedforward:
            offset = -(s.X_W_tip[:3, :3] @ self.R_tipT @ self.gauge.p_Ttip)
        if not self.observers:
            return np.asarray(tip_wanted + offset)
        lever = self._lever
        undeflected = self._position_part @ (tip_wanted + offset + lever)
        for i, n in enumerate(self.normals):
            base = self._base(i)
            now = float(n @ (self._undeflected - base))
            step = self._along(i, n, tip_wanted, offset + lever) - now
            bound = self._speed(i, s, loop_time) * dt
            undeflected = undeflected + (now + min(max(step, -bound), bound) + float(n @ base)) * n
        self._undeflected = undeflected
        return np.asarray(undeflected - lever)

    def _base(self, i: int) -> Array:
        return self.observers[i].anchor if self.contact and self.features.observer else self.tip

    def _along(self, i: int, n: Array, tip_wanted: Array, from_tip: Array) -> float:
        """Wanted undeflected height along n, counted from the base."""
        if not self.contact and self._wanted[i] == 0.0:  # nothing to walk towards
            return float(n @ (tip_wanted + from_tip - self.tip))
        if not (self.contact and self.features.observer):
            return float(self.deflections[i])
        return self.observers[i].target(n, tip_wanted, float(self.deflections[i]))

    def _speed(self, i: int, s: HybridSetpoint, loop_time: float) -> float:
        """Bound on the speed along n: before contact the grasp must not deflect further within a loop than wanted."""
        v = s.approach_speed or self.parameters.approach_speed
        if not self.features.observer:
            return v
        needed = abs(float(self._wanted[i])) / self._stiffness_along()
        if self.contact:
            return max(v, min(self.parameters.press_speed, needed / _PRESS_TIME))
        return min(v, max(_APPROACH_SHARE * needed / loop_time, _SLOWEST))


def _mixed(a: Wrench, b: Wrench, share: float) -> Wrench:
    return Wrench(a.torque + share * (b.torque - a.torque), a.force + share * (b.force - a.force))


def _triple(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def _directions(P: Array, m: int) -> Array:
    """(m, 3) orthonormal basis of the range of the projector P, always the same one for the same P."""
    if m == 3:
        return np.eye(3)
    if m == 0:
        return np.zeros((0, 3))
    order = np.argsort(-np.diag(P), kind="stable")
    out: list[Array] = []
    for i in order:
        v = P[i].copy()
        for n in out:
            v -= (n @ v) * n
        size = float(np.sqrt(v @ v))
        if size > 0.3:
            out.append(v / size)
        if len(out) == m:
            break
    return np.array(out)
