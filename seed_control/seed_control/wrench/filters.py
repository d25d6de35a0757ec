# SPDX-License-Identifier: Apache-2.0
"""Low-passes of what the images say, each with the time constant of its purpose."""

from math import inf

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_control.wrench.estimate import ROTATION_DEVIATION, Measurement, share_of
from seed_core.spatial import Array, Wrench, make_pose, rpy_from_rotation, so3_exp, so3_log

SIDE_LOOPS = 1.5  # times of a deflection that is fed forward, in which a side force is given way to: nothing hurries


class ToolFilter:
    """The tool in the grasp and in the world, smoothed. The first image is taken over as it is.

    Attributes:
        R_WT: (3, 3), by as much as the stated noise of rotations asks; X_WT: (4, 4) with the tip at its place,
            over `force_filter`. Both are the newest image's where the pose is not smoothed.
        p_TC: (3,) [m], spring: load on the tool in T, on_environment: in W, over `rotation_filter`.
        discrepancy: between bushing and wrench model, in T, over `discrepancy_filter`; None while the model is the
            bushing.
    """

    def __init__(self, parameters: ControllerParameters, p_Ttip: Array, smoothed: bool) -> None:
        self._parameters, self._p_Ttip, self._smoothed = parameters, p_Ttip, smoothed
        self._stamp = -inf
        self._tip = np.zeros(3)
        self.R_WT, self.X_WT, self.p_TC = np.eye(3), np.eye(4), np.zeros(3)
        self.spring = self.on_environment = Wrench.zero()
        self.discrepancy: Wrench | None = None

    def update(self, m: Measurement) -> None:
        """Take in one image."""
        p, dt = self._parameters, m.stamp - self._stamp
        self._stamp = m.stamp
        a = share_of(dt, p.rotation_filter)
        self.p_TC = self.p_TC + a * (m.X_TC[:3, 3] - self.p_TC)
        self.spring = _mixed(self.spring, m.spring, a)
        self.on_environment = _mixed(self.on_environment, m.on_environment, a)
        if m.discrepancy is None:
            self.discrepancy = None
        else:
            b = share_of(dt, p.discrepancy_filter)
            self.discrepancy = m.discrepancy if self.discrepancy is None else _mixed(self.discrepancy, m.discrepancy, b)
        if not self._smoothed or dt == inf:
            self.R_WT, self._tip = m.X_WT[:3, :3], m.tip
        else:
            smoothing = p.rotation_filter * min(m.rotation_deviation / ROTATION_DEVIATION, 1.0)
            self.R_WT = self.R_WT @ so3_exp(share_of(dt, smoothing) * so3_log(self.R_WT.T @ m.X_WT[:3, :3]))
            self._tip = self._tip + share_of(dt, p.force_filter) * (m.tip - self._tip)
        self.X_WT = make_pose(self.R_WT, self._tip - self.R_WT @ self._p_Ttip)


class DeflectionFilter:
    """The deflection that is fed forward, slowly.

    Attributes:
        q: (3,) rpy of R_TC [rad]. tip_to_C: (3,) from the tip to the gripper, in W [m].
        yielded: (3,) part of tip_to_C in which the gripper gives way to a side force, in W [m].
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        self._parameters = parameters
        self._stamp = -inf
        self.q, self.tip_to_C, self.yielded = np.zeros(3), np.zeros(3), np.zeros(3)

    def update(self, m: Measurement, loop_time: float, tipping_gain: float, yielding: Array | None = None) -> None:
        """Take in one image, whose answer takes loop_time [s].

        What is fed forward has the tipping gain in its loop, so its time grows with it. While a tip sticks, the place
        winds up, and what it is shifted by leans a tool near tipping: it has to be much slower than the uprighting.

        yielding: (3, 3) in W, along side directions the grasp's stiffness over the one that the tip shall feel.
        """
        p, dt = self._parameters, m.stamp - self._stamp
        self._stamp = m.stamp
        least = p.feedforward_ratio * loop_time
        fast = share_of(dt, max(p.angle_feedforward, least) * tipping_gain)
        slow = share_of(dt, max(p.position_feedforward, least) * tipping_gain**3)
        self.q = self.q + fast * (rpy_from_rotation(m.X_TC[:3, :3]) - self.q)
        self.tip_to_C = self.tip_to_C + slow * (m.X_WC[:3, 3] - m.tip - self.tip_to_C)
        if yielding is None:
            self.yielded = np.zeros(3)
            return
        # F = K d at the gripper's C = tip + d + ..., commanded to give way by (K / k) d: the loop has that gain
        gain = max(sum(yielding.diagonal().tolist()), 1.0)
        gentle = share_of(dt, SIDE_LOOPS * max(p.position_feedforward, least) * gain)
        deflection = m.X_WT[:3, :3] @ m.X_TC[:3, 3]
        self.yielded = self.yielded + gentle * (yielding @ deflection - self.yielded)


def _mixed(a: Wrench, b: Wrench, share: float) -> Wrench:
    return Wrench(a.torque + share * (b.torque - a.torque), a.force + share * (b.force - a.force))
