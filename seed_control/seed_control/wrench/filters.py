# SPDX-License-Identifier: Apache-2.0
"""Low-passes of what the images say, each with the time constant of its purpose."""

from __future__ import annotations

from math import exp

from seed_control.law.features import Features
from seed_control.parameters import ControllerParameters
from seed_control.wrench.estimate import ROTATION_DEVIATION, Measurement
from seed_core.spatial import Array, Wrench, rpy_from_rotation, so3_exp, so3_log


def share_of(dt: float, tau: float) -> float:
    """Weight of a new sample in a first-order low-pass of time constant tau [s] after dt [s]."""
    return 1.0 - exp(-dt / tau) if tau > 0.0 else 1.0


class ToolFilter:
    """The tool in the grasp and in the world, smoothed.

    Attributes:
        R_WT: (3, 3), by as much as the stated noise of rotations asks.
        q: rpy (3,) of R_TC [rad] and offset: (3,) from tip to gripper in W [m], slowly: both are fed forward.
        p_TC: (3,) [m], spring: load on the tool in T, on_environment: in W, over `rotation_filter`.
        tip: (3,) [m] in W, over `force_filter`.
    """

    def __init__(self, features: Features, parameters: ControllerParameters) -> None:
        self._parameters, self._filtered = parameters, features.filtered
        self._stamp: float | None = None

    def update(self, m: Measurement, loop_time: float, tipping_gain: float) -> None:
        """Take in one image, whose answer takes loop_time [s].

        What is fed forward has the tipping gain in its loop, so its time grows with it. While a tip sticks, the place
        winds up, and what it is shifted by leans a tool near tipping: it has to be much slower than the uprighting.
        """
        q, offset = rpy_from_rotation(m.X_TC[:3, :3]), m.X_WC[:3, 3] - m.tip
        if self._stamp is None:
            self.R_WT, self.q, self.offset = m.X_WT[:3, :3].copy(), q, offset
            self.p_TC, self.spring, self.on_environment = m.X_TC[:3, 3].copy(), m.spring, m.on_environment
            self.tip = m.tip.copy()
        else:
            self._mix(m, m.stamp - self._stamp, q, offset, loop_time, tipping_gain)
        self._stamp = m.stamp

    def _mix(self, m: Measurement, dt: float, q: Array, offset: Array, loop_time: float, gain: float) -> None:
        p = self._parameters
        smoothing = p.rotation_filter * min(m.rotation_deviation / ROTATION_DEVIATION, 1.0)
        self.R_WT = self.R_WT @ so3_exp(self._share(dt, smoothing) * so3_log(self.R_WT.T @ m.X_WT[:3, :3]))
        least = p.feedforward_ratio * loop_time
        self.q = self.q + share_of(dt, max(p.angle_feedforward, least) * gain) * (q - self.q)
        slow = max(p.position_feedforward, least) * gain**3
        self.offset = self.offset + share_of(dt, slow) * (offset - self.offset)
        a = share_of(dt, p.rotation_filter)
        self.p_TC = self.p_TC + a * (m.X_TC[:3, 3] - self.p_TC)
        self.spring = _mixed(self.spring, m.spring, a)
        self.on_environment = _mixed(self.on_environment, m.on_environment, a)
        self.tip = self.tip + self._share(dt, p.force_filter) * (m.tip - self.tip)

    def _share(self, dt: float, tau: float) -> float:
        return share_of(dt, tau) if self._filtered else 1.0


def _mixed(a: Wrench, b: Wrench, share: float) -> Wrench:
    return Wrench(a.torque + share * (b.torque - a.torque), a.force + share * (b.force - a.force))
