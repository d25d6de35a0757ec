# SPDX-License-Identifier: Apache-2.0
"""One control law for force, torque, position and angle at once: from images and a set-point to a gripper pose.

This is the geometry, done at the camera's rate; `walk` is the little that changes with every step.
"""

from __future__ import annotations

import numpy as np

from seed_control.law.contact import ContactJudge
from seed_control.law.directions import force_directions
from seed_control.law.features import Features
from seed_control.law.partial_inverse import PartialInverseError, hybrid_translation, partial_angles
from seed_control.law.surface_observer import ObserverTuning, SurfaceObserver
from seed_control.law.tip_reference import Plan, Walk
from seed_control.law.tipping import tipping_gain
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.wrench.estimate import Gauge, Measurement
from seed_control.wrench.filters import ToolFilter
from seed_core.spatial import Array, Wrench, cross, make_pose, rotation_from_rpy, rpy_from_rotation, so3_exp, so3_log
from seed_core.vector3 import Vector3, as_vector3


class HybridLaw:
    """State: the smoothed tool, whether it touches, and an observer per force direction."""

    setpoint: HybridSetpoint | None
    limits: tuple[str, ...]

    def __init__(self, features: Features, parameters: ControllerParameters, gauge: Gauge) -> None:
        self.features, self.parameters, self.gauge = features, parameters, gauge
        self.X_Ttip = gauge.tool.X_Ttip
        self.R_tipT = self.X_Ttip[:3, :3].T.copy()
        self.tool = ToolFilter(features, parameters)
        self.touch = ContactJudge(parameters)
        self.walk = Walk(features, parameters)
        self.X_W_tip: Array | None = None
        self.estimated_task: Wrench | None = None
        self.filtered_task: Wrench | None = None
        self.measured: Measurement | None = None
        self.R_WC = np.eye(3)  # wanted rotation of the gripper
        self.loop_time = 0.1  # [s] from an image to the arm's answer, set by whoever knows
        self.release()

    @property
    def contact(self) -> bool:
        """Whether the tool touches."""
        return self.touch.made

    # --- set-point ---------------------------------------------------------------------------------------------
    def adopt(self, setpoint: HybridSetpoint, p_WC: Vector3) -> None:
        """Follow a set-point from now on; p_WC is the commanded gripper position [m], for a start without a jump."""
        before = self.setpoint
        self.setpoint = setpoint
        if self.measured is None:
            return
        same = before is not None and (
            before.task_frame == setpoint.task_frame
            and np.array_equal(before.force_projector, setpoint.force_projector)
        )
        self._task_axes(setpoint)
        if not same:
            self._new_directions(setpoint, p_WC)
        self.walk.renew(self._solve(setpoint), self.contact)
        self._write_wrenches(self.measured)

    def _task_axes(self, s: HybridSetpoint) -> None:
        self.R_W_task = self.tool.R_WT @ self.R_tipT.T if s.task_frame == "tool" else s.R_W_task

    def _new_directions(self, s: HybridSetpoint, p_WC: Vector3) -> None:
        """Other force directions than before: contact is to be found anew."""
        p = self.parameters
        tuning = ObserverTuning(1e-3 * p.surface_noise, p.slope_noise, 2e-3, p.slope_prior, p.compliance_prior)
        self.walk.observers = [SurfaceObserver(tuning) for _ in range(round(float(s.force_projector.trace())))]
        self.walk.undeflected = as_vector3(np.array(p_WC) + self.tool.R_WT @ self.gauge.p_Ttip)
        self.touch.reset()

    def release(self) -> None:
        """Follow nothing until the next `adopt`: all that a set-point has brought goes with it, here and only here."""
        self.setpoint = None
        self.R_W_task = np.eye(3)
        self.X_TC_wanted = np.eye(4)
        self.normals = np.zeros((0, 3))  # (m, 3) force directions in W
        self._wanted = np.zeros(0)  # (m,) force along the normals [N]
        self._tipping_gain = 1.0
        self.settled = False
        self.limits = ()
        self.touch.reset()
        self.walk.reset()
        if self.measured is not None:
            self._write_wrenches(self.measured)

    @property
    def regulates_force(self) -> bool:
        """Whether any direction carries force."""
        return bool(self.walk.observers)

    # --- per image ---------------------------------------------------------------------------------------------
    def image(self, m: Measurement) -> None:
        """Take in a new image's measurement and renew what follows from it."""
        self.tool.update(m, self.loop_time, self._tipping_gain)
        self.measured = m
        if self.setpoint is not None:
            self._task_axes(self.setpoint)
            plan = self._solve(self.setpoint)
            self._judge_contact(m)
            for n, observer in zip(self.normals, self.walk.observers, strict=True):
                if self.contact:
                    observer.update(m.stamp, n, m.tip, m.undeflected, m.variance)
            self.walk.renew(plan, self.contact)
        self._tell(m)

    def _judge_contact(self, m: Measurement) -> None:
        deviation = self.gauge.mean_stiffness * m.variance**0.5
        if self.touch.update(self.normals @ m.on_environment.force, self._wanted, deviation):
            for n, observer in zip(self.normals, self.walk.observers, strict=True):
                observer.start(m.stamp, n, m.tip, m.undeflected)

    def _tell(self, m: Measurement) -> None:
        """What the state shows of this image."""
        filtered = self.tool.on_environment
        self.X_W_tip = m.X_WT @ self.X_Ttip
        self._write_wrenches(m)
        error = np.abs(self.normals @ filtered.force - self._wanted)
        self.settled = self.contact and bool((error < np.maximum(0.1 * np.abs(self._wanted), 0.3)).all())

    def _write_wrenches(self, m: Measurement) -> None:
        """In the task frame, whenever an image or a set-point changes one of the two."""
        self.estimated_task = m.on_environment.rotated(self.R_W_task.T)
        self.filtered_task = self.tool.on_environment.rotated(self.R_W_task.T)

    def _solve(self, s: HybridSetpoint) -> Plan:
        """Wanted gripper rotation, and the walk's plan, from the set-point and the newest filtered measurement."""
        self.limits = ()
        P = self.R_W_task @ s.force_projector @ self.R_W_task.T
        self.normals = force_directions(P, len(self.walk.observers))
        self._wanted = self.normals @ (self.R_W_task @ s.wrench.force)
        force_T = self.tool.R_WT.T @ (self.R_W_task @ s.wrench.force)
        stiffness = self.gauge.bushing.stiffness
        # fed-forward deflection has this gain in its loop: its time grows with it, so the loop's speed stays the same
        self._tipping_gain = tipping_gain(force_T, self.gauge.p_Ttip, s.torque_axes, stiffness)
        self._solve_rotation(s, P)
        d = self._solve_translation(s, P)
        tip_to_C = self.tool.offset
        if not self.features.feedforward:
            tip_to_C = -(s.X_W_tip[:3, :3] @ self.R_tipT @ self.gauge.p_Ttip)
        return Plan(
            normals=[as_vector3(n) for n in self.normals],
            wanted=self._wanted.tolist(),
            deflections=(self.normals @ d).tolist(),
            softness=1.0 / self.gauge.mean_stiffness,
            tip=as_vector3(self.tool.tip),
            lever=as_vector3(self.tool.R_WT @ self.gauge.p_Ttip),
            tip_to_C=as_vector3(tip_to_C),
            approach_speed=s.approach_speed or self.parameters.approach_speed,
        )

    def _solve_rotation(self, s: HybridSetpoint, P: Array) -> None:
        R_WT_des = s.X_W_tip[:3, :3] @ self.R_tipT
        q = self.tool.q if self.features.feedforward else np.zeros(3)
        self.R_WC = R_WT_des @ rotation_from_rpy(q)
        if not any(s.torque_axes) or not self.contact:
            return
        R_WT = self.tool.R_WT
        angles = rpy_from_rotation(R_WT.T @ self.R_WC)
        torque = self._gimbal_torque(s, P)
        k = self.gauge.bushing.stiffness.rotation
        try:
            wanted = partial_angles(k, as_vector3(torque), as_vector3(angles), s.torque_axes, float(angles[1]))
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
        R_WT, gauge, felt = self.tool.R_WT, self.gauge, self.tool.on_environment.force
        force_T = R_WT.T @ (P @ (self.R_W_task @ s.wrench.force) + felt - P @ felt)
        torque = R_WT.T @ (self.R_W_task @ s.wrench.torque) + cross(gauge.p_Ttip, force_T)
        torque = torque - gauge.weight(R_WT).torque
        if gauge.bushing.model == "midpoint":
            torque = torque - 0.5 * cross(self.tool.p_TC, self.tool.spring.force)
        return torque

    def _solve_translation(self, s: HybridSetpoint, P: Array) -> Array:
        """Wanted displacement (3,) [m] of the gripper from the tool, in W."""
        R_WT, gauge = self.tool.R_WT, self.gauge
        R_TC = R_WT.T @ self.R_WC
        K = R_WT @ gauge.bushing.translation_stiffness(R_TC) @ R_WT.T
        force = self.R_W_task @ s.wrench.force - R_WT @ gauge.weight(R_WT).force
        d = hybrid_translation(P, K, R_WT @ self.tool.p_TC, force)
        size, bound = float(np.sqrt(d @ d)), self.parameters.max_deflection
        if size > bound:
            self.limits += ("max_deflection",)
            d = d * (bound / size)
        self.X_TC_wanted = make_pose(R_TC, R_WT.T @ d)
        return d
