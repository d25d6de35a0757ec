# SPDX-License-Identifier: Apache-2.0
"""Whether a set-point can be followed with this hand, tool, grasp and estimator: refusals SP09 to SP16, and SP18.

Every set-point is judged before anything changes; whatever refuses raises SetpointError.
"""

from math import cos, radians, sin

import numpy as np

from seed_control.algorithm2 import wrench_about_T
from seed_control.law.directions import force_directions
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import (
    AxisFlags,
    HybridSetpoint,
    RelativePoseSetpoint,
    SetpointError,
    WrenchSetpoint,
)
from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_core.bushing import Bushing, BushingError, Stiffness
from seed_core.estimate import AXES, RelativePoseEstimate
from seed_core.hand import Hand
from seed_core.spatial import Array, Wrench, inverse_pose, rpy_from_rotation, so3_log

_TORQUE_TOLERANCE = 1e-6  # [N m]
_NO_DISPLACEMENT = 1e-6  # [m], [rad]
_OBSERVED_SHARE = 0.2  # how much of a force direction may lie along an unobserved axis


class SetpointChecks:
    """The checks of one controller, hand, tool and grasp.

    Attributes:
        clock_problem: why force and torque must not be controlled before the clocks are compared; '' where they may.
        stamp_problem: the same of what the images' stamps have shown since.
    """

    clock_problem = stamp_problem = ""

    def __init__(self, parameters: ControllerParameters, wrench_estimator: WrenchEstimator, hand: Hand) -> None:
        self.parameters, self._wrench_estimator = parameters, wrench_estimator
        self._X_Ttip = wrench_estimator.tool.X_Ttip
        self._X_tipE = inverse_pose(self._X_Ttip) @ inverse_pose(hand.X_EC)  # of an undeflected grasp

    @property
    def why_no_force(self) -> str:
        """Why the clocks allow no force or torque; '' where they do."""
        return self.clock_problem or self.stamp_problem

    def check_stamp(self, stamp: float | None, now: float) -> None:
        """SP10: a stamp [s] that is too old, or more than 50 ms in the future."""
        oldest = self.parameters.setpoint_max_age
        if stamp is not None and not -0.05 <= now - stamp <= oldest:
            raise SetpointError(
                "SP10",
                f"set-point is stamped {now - stamp:.3f} s ago; at most {oldest:g} s is accepted: check the clocks",
            )

    def check_displacement(self, s: RelativePoseSetpoint, estimate: RelativePoseEstimate, R_WT: Array) -> None:
        """SP11, SP13, SP15, SP18: whether grasp, estimator and clocks bear the displacement asked for, and its load.

        Args:
            R_WT: (3, 3) of the tool.
        """
        if self.why_no_force:
            raise SetpointError("SP18", f"a displacement of the grasp waits for the clocks: {self.why_no_force}")
        _check_observed(unobserved_displacement(s.X_TC, estimate))
        self._check_deflection(s.X_TC)
        self.check_displacement_load(s, R_WT)

    def check_displacement_load(self, s: RelativePoseSetpoint, R_WT: Array, bushing: Bushing | None = None) -> None:
        """SP11: the load of a displacement, on the environment, is beyond what may be asked for.

        Args:
            R_WT: (3, 3) of the tool. bushing: None for the one in use.
        """
        known = self._wrench_estimator
        self.check_size((bushing or known.bushing).wrench(s.X_TC).plus(known.weight(R_WT)).about(known.p_Ttip))

    def as_hybrid(
        self, s: HybridSetpoint | WrenchSetpoint, m: Measurement, before: HybridSetpoint | None = None
    ) -> HybridSetpoint:
        """The form that the law follows.

        A wrench (Algorithm 2, not hybrid): every direction carries force, and angles are torque where a contact resists
        them.

        Args:
            m: the newest measurement.
            before: what a stream of wrenches has come to so far, whose orientation is held on, and from which torque
                may turn by `max_drift`; None: the present one.
        """
        if isinstance(s, HybridSetpoint):
            return s
        if any(s.contact_resists) != all(s.contact_resists):
            raise SetpointError(
                "SP09",
                "a wrench set-point needs contact_resists about all three axes or none; use a "
                "hybrid set-point for some of them",
            )
        X_W_tip = m.X_WT @ self._X_Ttip
        if before is not None:
            X_W_tip[:3, :3] = before.X_W_tip[:3, :3]
        return HybridSetpoint(
            X_W_tip=X_W_tip,
            wrench=s.wrench,
            force_projector=np.eye(3),
            torque_axes=s.contact_resists,
            task_frame=s.frame,
            contact_resists=s.contact_resists,
        )

    def check_load(
        self, s: HybridSetpoint, estimate: RelativePoseEstimate, R_WC: Array, bushing: Bushing | None = None
    ) -> None:
        """SP11 to SP15, SP18: whether grasp, contact, estimator and clocks bear the force and torque asked for.

        Args:
            R_WC: (3, 3) of the gripper at the estimate. bushing: of the grasp; None for the one in use.
        """
        bushing = bushing or self._wrench_estimator.bushing
        if self.why_no_force and (s.force_projector.any() or any(s.torque_axes)):
            raise SetpointError("SP18", f"force and torque wait for the clocks: {self.why_no_force}")
        self.check_size(s.wrench)
        R_W_tip = s.X_W_tip[:3, :3]
        R_WT, R_W_task = R_W_tip @ self._X_Ttip[:3, :3].T, R_W_tip if s.task_frame == "tool" else s.R_W_task
        load_W, wrench_estimator = s.wrench.rotated(R_W_task), self._wrench_estimator
        load_T = load_W.rotated(R_WT.T)  # about the tip
        _check_torque_axes(s.torque_axes, load_T.torque)
        spring = wrench_about_T(load_W, R_WT, wrench_estimator.p_Ttip).minus(wrench_estimator.weight(R_WT))
        try:
            X_TC = bushing.pose(spring)
        except BushingError as error:
            raise SetpointError("SP13", str(error)) from error
        self._check_deflection(X_TC)
        self._check_tipping(load_T.force, s.torque_axes, bushing.stiffness)
        directions, _ = force_directions(R_W_task @ s.force_projector @ R_W_task.T, None, R_W_task)
        _check_observed(unobserved_load(directions, s.torque_axes, estimate, R_WC))

    def check_place(self, X_W_tip: Array) -> None:
        """SP16: a flange position outside of the workspace box, for the wanted tip at X_W_tip (4, 4)."""
        position = (X_W_tip @ self._X_tipE)[:3, 3]
        low, high = self.parameters.workspace_low, self.parameters.workspace_high
        if not all(a <= x <= b for a, x, b in zip(low, position.tolist(), high, strict=True)):
            raise SetpointError(
                "SP16", f"puts the flange at {np.round(position, 3)} m, outside of the workspace {low} to {high} m"
            )

    def check_size(self, wrench: Wrench) -> None:
        """SP11: a force or torque beyond what may be asked for."""
        p = self.parameters
        for name, vector, bound, unit in (
            ("force", wrench.force, p.max_force, "N"),
            ("torque", wrench.torque, p.max_torque, "N m"),
        ):
            size = float(np.linalg.norm(vector))
            if size > bound * (1 + 1e-9):
                raise SetpointError("SP11", f"{name} of {size:.3g} {unit} is beyond max_{name} = {bound:g} {unit}")

    def _check_deflection(self, X_TC: Array) -> None:
        """SP13: more deflection of the grasp than it endures without slip."""
        p, d = self.parameters, float(np.linalg.norm(X_TC[:3, 3]))
        if d > p.max_deflection:
            raise SetpointError(
                "SP13",
                f"needs a deflection of {1e3 * d:.1f} mm, at most {1e3 * p.max_deflection:.1f} mm is safe "
                "against slip: ask for less force or a stiffer grip",
            )
        worst = float(np.rad2deg(np.abs(rpy_from_rotation(X_TC[:3, :3])).max()))
        if worst > p.max_rotation:
            raise SetpointError(
                "SP13",
                f"needs a rotation of {worst:.1f} degrees in the grasp, at most {p.max_rotation:g} is safe "
                "against slip: ask for less torque or a stiffer grip",
            )

    def _check_tipping(self, force_T: Array, torque_axes: AxisFlags, stiffness: Stiffness) -> None:
        """SP14: pressing with F at lever H tips a tool whose angle-controlled axes are too soft for it.

        A lean a is at rest where k a = F H (sin a + mu cos a), with the friction mu F across the tip; there is such a
        lean up to the largest one that the grasp endures where k is at least F H (sin a + mu cos a) / a of that one.
        """
        size, moment = float(np.linalg.norm(force_T)), float(force_T @ self._wrench_estimator.p_Ttip)  # F H
        if moment <= 0.0:
            return
        most, mu = radians(self.parameters.max_rotation), self.parameters.friction
        needed = (sin(most) + mu * cos(most)) / most * moment
        for i, k in enumerate(stiffness.rotation):
            if torque_axes[i] or abs(force_T[i]) > 0.9 * size:  # about the force's own axis nothing tips
                continue
            if k < needed:
                raise SetpointError(
                    "SP14",
                    f"the tool would tip: {size:.3g} N at a lever of {moment / size:.3g} m with a friction of {mu:g} "
                    f"needs {needed:.3g} N m/rad about T's {'xyz'[i]}, the grasp has {k:.3g}: ask for at most "
                    f"{size * k / needed:.3g} N or a stiffer grip",
                )


def _check_torque_axes(torque_axes: AxisFlags, torque_T: Array) -> None:
    """SP12: a wanted torque about an axis of T that holds its angle."""
    for i, on in enumerate(torque_axes):
        if not on and abs(torque_T[i]) > _TORQUE_TOLERANCE:
            raise SetpointError(
                "SP12",
                f"torque of {torque_T[i]:.3g} N m about T's {'xyz'[i]}, which holds its angle: pair tx with roll, ty "
                "with pitch, tz with yaw; set torque_axes, or give a torque of zero about that axis",
            )


def _check_observed(unobserved: str) -> None:
    """SP15: why an estimator cannot serve a set-point."""
    if unobserved:
        raise SetpointError("SP15", unobserved)


def unobserved_load(directions: Array, torque_axes: AxisFlags, estimate: RelativePoseEstimate, R_WC: Array) -> str:
    """Which force or torque lies on an axis that the estimate does not observe (Sec. VIII-B); '' for none.

    Args:
        directions: (m, 3) of force, unit vectors in W. torque_axes: of T, that carry torque.
        R_WC: (3, 3) of the gripper.
    """
    for n in directions:
        for i, share in enumerate(R_WC.T @ n):
            if not estimate.observed_translation[i] and abs(share) > _OBSERVED_SHARE:
                return (
                    f"force along C's {'xyz'[i]}, which the estimator does not observe: align the force with an "
                    "observed axis of the hand, or use an estimator that sees it"
                )
    for i, on in enumerate(torque_axes):
        if on and not estimate.observed_rotation[i]:
            return f"torque about T's {'xyz'[i]}: the estimator does not observe {AXES[3 + i]}"
    return ""


def unobserved_displacement(X_TC: Array, estimate: RelativePoseEstimate) -> str:
    """Which part of a wanted displacement X_TC (4, 4) the estimate does not observe; '' for none.

    Along such an axis the tool counts as undeflected, so the gripper would go on and on.
    """
    X_CT = inverse_pose(X_TC)
    parts = *X_CT[:3, 3].tolist(), *so3_log(X_CT[:3, :3]).tolist()
    for name, part, seen, unit in zip(AXES, parts, estimate.observed, ("m",) * 3 + ("rad",) * 3, strict=True):
        if not seen and abs(part) > _NO_DISPLACEMENT:
            return f"a displacement of {part:.3g} {unit} in {name}, which the estimator does not observe"
    return ""
