# SPDX-License-Identifier: Apache-2.0
"""Whether the arm follows the command: one that holds, or is slowed down, is noticed and told."""

from math import inf

from seed_core.spatial import Array
from seed_core.vector3 import Vector3, dot, minus

_TRAILS = 0.1  # [s] of the command's motion by which an arm may be behind, beyond the lag that was learnt
_LASTS = 0.1  # [s] for which it has to be further behind
_MOVES, _NEAR, _PATIENCE = 2e-4, 1.5e-3, 0.3  # [m], [m], [s]: so little an arm moves that stands, away from its command
_SLOWS = 0.9  # share of the speed that is kept per 10 ms, so that the bound outlives the motion


class ArmFollows:
    """`update` at every step while set-points are followed."""

    def __init__(self, bound: float) -> None:
        """bound: [m] by which command and arm may differ at rest."""
        self._bound = bound
        self.restart()

    def restart(self) -> None:
        """The command starts anew from where the arm is."""
        self._speed = self._behind = 0.0
        self._last: Vector3 | None = None
        self._stands_at, self._stands = (inf, inf, inf), 0.0  # [m], [s] since when the arm has not moved

    def update(self, command: Vector3, X_WC: Array, lag: float, dt: float) -> str:
        """Take in where C is commanded [m] and where it is (4, 4), a step of dt [s] later; why to hold, or ''.

        Args:
            lag: [s] by which the arm is known to trail.
        """
        last, self._last = self._last, command
        if last is not None:
            step = minus(command, last)
            self._speed = max(dot(step, step) ** 0.5 / dt, self._speed * _SLOWS ** (dt / 0.01))
        x, y, z = X_WC[:3, 3].tolist()
        off, went = minus(command, (x, y, z)), minus((x, y, z), self._stands_at)
        distance = dot(off, off) ** 0.5
        self._stands += dt
        if not dot(went, went) < _MOVES * _MOVES or distance < _NEAR:
            self._stands_at, self._stands = (x, y, z), 0.0
        if self._stands <= _PATIENCE and distance <= self._bound + (min(lag, _TRAILS) + _TRAILS) * self._speed:
            self._behind = 0.0
            return ""
        self._behind += dt
        if self._behind < _LASTS and self._stands <= _PATIENCE:
            return ""
        return (
            f"the arm does not follow: it is {1e3 * distance:.1f} mm from its command (max_tracking_error = "
            f"{1e3 * self._bound:g} mm): see why the driver holds or is slowed down, resume it, then enable"
        )
