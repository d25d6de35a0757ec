# SPDX-License-Identifier: Apache-2.0
"""How far the poses of an identification may go in this grasp, learnt from those that were visited.

Planning knows a rough stiffness. What the grasp bears shows on the way: an axis that met a limit, or on which the
estimator lost the tool, is not driven that far again; and combinations keep below the wrench limit by the stiffness
that the single axes have shown.
"""

from dataclasses import replace

import numpy as np

from seed_core.spatial import Array, so3_log
from seed_sysid.parameters import ExcitationParameters, LimitParameters
from seed_sysid.run.excitation import Target
from seed_sysid.stiffness_map import AXES

_MARGIN = 0.9  # of the wrench limit that combinations are to reach at most
_FEWER = 0.85  # factor on combinations after one that could not be visited
_LEAST = 0.3  # factor below which nothing is reduced
_SLOW, _FAST = 0.7, 1.4  # bounds on what one pose of the work changes of the next
_TOLD = 0.3  # share of the largest force, or torque, of a load that tells about its axis


class Reach:
    """Of one run.

    Attributes:
        axis: (6,) share of each axis' amplitude that the grasp bears. combined: the same of combinations as a whole.
        work: (6,) factor on poses of the work, by axis.
    """

    def __init__(self, excitation: ExcitationParameters, limits: LimitParameters) -> None:
        self._excitation, self._limits = excitation, limits
        self.axis, self.combined = np.ones(6), 1.0
        self._stiffness = np.zeros(6)  # [N m/rad, N/m] seen along each axis
        self.work: Array | None = None

    def within(self, target: Target) -> Target:
        """The target, drawn towards the centre as far as what was learnt asks for."""
        if target.kind == "work":
            if self.work is None:
                guess = self._excitation.guess.vector()
                self.work = guess / np.where(self._stiffness > 0.0, self._stiffness, guess)
            of_load = np.array(target.load) / self._excitation.guess.vector()
            return replace(target, xi=tuple((np.array(target.turn) + self.work * of_load).tolist()))
        return target.scaled(self._factor(target))

    def _factor(self, target: Target) -> float:
        xi = np.array(target.xi)
        share = np.abs(xi) / (self._excitation.amplitudes * self.axis)
        if target.kind in AXES:
            return 1.0 / max(1.0, float(share.max()))
        load, most = self._stiffness * xi, self._limits
        uses = (
            float(share.max()) / self._excitation.combined,
            float(np.linalg.norm(load[3:])) / (_MARGIN * most.force),
            float(np.linalg.norm(load[:3])) / (_MARGIN * most.torque),
        )
        return self.combined / max(1.0, *uses)

    def failed(self, target: Target, factor: float) -> None:
        """A target could not be visited and is tried again at a factor of it."""
        if target.kind in AXES:
            j = AXES.index(target.kind)
            share = factor * abs(target.xi[j]) / self._excitation.amplitudes[j]
            self.axis[j] = min(self.axis[j], max(share, _LEAST))
        elif target.kind == "work":
            self.work = _FEWER * self.work if self.work is not None else None
        else:
            self.combined = max(_LEAST, _FEWER * self.combined)

    def measured(self, target: Target, wrench: Array) -> None:
        """A target was visited and the tool bore a wrench (6,) [N m, N] there, in T."""
        if target.kind in AXES:
            j = AXES.index(target.kind)
            self._stiffness[j] = max(self._stiffness[j], abs(float(wrench[j])) / max(abs(target.xi[j]), 1e-9))
        elif target.kind == "work" and self.work is not None:
            load, wrench = np.array(target.load), wrench - self._stiffness * np.array(target.turn)
            size = np.repeat((np.abs(load[:3]).max(), np.abs(load[3:]).max()), 3)
            tells = np.abs(load) > _TOLD * size
            change = load[tells] / np.where(wrench[tells] * load[tells] > 0.0, wrench[tells], load[tells])
            self.work[tells] *= np.clip(change, _SLOW, _FAST)


def limit_reached(X_TC: Array, wrench: Array, limits: LimitParameters) -> str:
    """The limit that displacement X_TC (4, 4) or wrench (6,) (bias taken off) exceeds, with its value; '' if none."""
    turn = float(np.rad2deg(np.linalg.norm(so3_log(X_TC[:3, :3]))))
    shift = float(np.linalg.norm(X_TC[:3, 3]))
    torque, force = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
    if turn > 1.02 * limits.rotation_deg:  # 2 %: the command itself may lie on the limit
        return f"rotation {turn:.1f} deg exceeds limits.rotation_deg = {limits.rotation_deg:g} deg"
    if shift > 1.02 * limits.translation:
        return f"deflection {1e3 * shift:.1f} mm exceeds limits.translation = {1e3 * limits.translation:g} mm"
    if force > limits.force:
        return f"force {force:.1f} N exceeds limits.force = {limits.force:g} N"
    if torque > limits.torque:
        return f"torque {torque:.2f} N m exceeds limits.torque = {limits.torque:g} N m"
    return ""


def load_share(wrench: Array, limits: LimitParameters) -> float:
    """The larger of force over limits.force and torque over limits.torque, of a wrench (6,)."""
    return max(float(np.linalg.norm(wrench[3:])) / limits.force, float(np.linalg.norm(wrench[:3])) / limits.torque)
