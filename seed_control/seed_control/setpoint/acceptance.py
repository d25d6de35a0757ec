# SPDX-License-Identifier: Apache-2.0
"""From what is asked to what the law follows: every set-point in one form, judged before anything changes."""

from __future__ import annotations

import numpy as np

from seed_control.law.tipping import check_tipping
from seed_control.parameters import ControllerParameters
from seed_control.setpoint import checks as admission
from seed_control.setpoint.setpoints import HybridSetpoint, RelativePoseSetpoint, SetpointError, WrenchSetpoint
from seed_control.wrench.estimate import Gauge, Measurement
from seed_core.bushing import BushingError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, Tool
from seed_core.spatial import Wrench, inverse_pose, rpy_from_rotation


class Acceptance:
    """The checks of one hand, tool and grasp; each raises SetpointError and leaves all as it was."""

    def __init__(self, parameters: ControllerParameters, gauge: Gauge, hand: Hand, tool: Tool) -> None:
        self._parameters, self._gauge = parameters, gauge
        self._X_Ttip = tool.X_Ttip
        self._R_tipT = self._X_Ttip[:3, :3].T.copy()
        self._X_tipE = inverse_pose(self._X_Ttip) @ inverse_pose(hand.X_EC)  # of an undeflected grasp

    def hybrid(
        self,
        s: HybridSetpoint | WrenchSetpoint,
        followed: HybridSetpoint | None,
        m: Measurement,
        estimate: RelativePoseEstimate,
    ) -> tuple[HybridSetpoint, bool]:
        """The set-point for the law, and whether it only moves the one that is followed.

        Args:
            m: the newest measurement, and the estimate that it was made of.
        """
        hybrid = self._as_hybrid(s, m) if isinstance(s, WrenchSetpoint) else s
        moved = _is_moved(followed, hybrid)
        if not moved:
            self._check_load(hybrid, m, estimate)
        X_WE = hybrid.X_W_tip @ self._X_tipE
        admission.check_workspace(X_WE[:3, 3], self._parameters)
        return hybrid, moved

    def displacement(self, s: RelativePoseSetpoint, estimate: RelativePoseEstimate) -> None:
        """Whether the grasp endures the displacement asked for, and the estimate observes it."""
        admission.check_observed(admission.unobserved_displacement(s.X_TC, estimate))
        admission.check_deflection(s.X_TC[:3, 3], rpy_from_rotation(s.X_TC[:3, :3]), self._parameters)

    def _check_load(self, s: HybridSetpoint, m: Measurement, estimate: RelativePoseEstimate) -> None:
        """Whether grasp, contact and estimator bear the force and torque asked for."""
        p, gauge = self._parameters, self._gauge
        admission.check_load(s.wrench, p)
        R_WT = s.X_W_tip[:3, :3] @ self._R_tipT
        R_W_task = s.X_W_tip[:3, :3] if s.task_frame == "tool" else s.R_W_task
        wanted = s.wrench.rotated(R_WT.T @ R_W_task)
        admission.check_torque_axes(s, wanted.torque)
        try:
            X_TC = gauge.bushing.pose(wanted.about(-gauge.p_Ttip).minus(gauge.weight(R_WT)))
        except BushingError as error:
            raise SetpointError("SP13", str(error)) from error
        admission.check_deflection(X_TC[:3, 3], rpy_from_rotation(X_TC[:3, :3]), p)
        stiffness = gauge.bushing.stiffness
        check_tipping(wanted.force, gauge.p_Ttip, s.torque_axes, stiffness, p.tipping_margin)
        P = R_W_task @ s.force_projector @ R_W_task.T
        directions = np.array([v for v in P if v @ v > 0.1])
        admission.check_observed(admission.unobserved_load(directions, s.torque_axes, estimate, m.X_WC[:3, :3]))

    def _as_hybrid(self, s: WrenchSetpoint, m: Measurement) -> HybridSetpoint:
        """Algorithm 2 alone: every direction carries force; angles are torque where a contact resists them."""
        if any(s.contact_resists) != all(s.contact_resists):
            raise SetpointError(
                "SP09",
                "a wrench set-point needs contact_resists about all three axes or none; use a "
                "hybrid set-point for some of them",
            )
        return HybridSetpoint(
            X_W_tip=m.X_WT @ self._X_Ttip,
            wrench=s.wrench,
            force_projector=np.eye(3),
            torque_axes=s.contact_resists,
            task_frame=s.frame,
            contact_resists=s.contact_resists,
        )


def _is_moved(old: HybridSetpoint | None, new: HybridSetpoint) -> bool:
    """Whether only the place differs, so that the load need not be judged again."""
    if old is None or not np.array_equal(old.X_W_tip[:3, :3], new.X_W_tip[:3, :3]):
        return False
    if old.wrench is new.wrench and old.force_projector is new.force_projector and old.R_W_task is new.R_W_task:
        return True  # one moved from the other
    return (
        old.task_frame == new.task_frame
        and old.torque_axes == new.torque_axes
        and old.approach_speed == new.approach_speed
        and _same(old.wrench, new.wrench)
        and np.array_equal(old.force_projector, new.force_projector)
        and np.array_equal(old.R_W_task, new.R_W_task)
    )


def _same(a: Wrench, b: Wrench) -> bool:
    return np.array_equal(a.force, b.force) and np.array_equal(a.torque, b.torque)
