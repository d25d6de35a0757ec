# SPDX-License-Identifier: Apache-2.0
"""Whether the arm follows the command: one that holds, or is slowed down, is noticed and told."""

from math import degrees, exp, inf
from typing import NamedTuple

from seed_core.vector3 import Vector3, dot, minus, norm

_TRAILS = 0.1  # [s] of the command's motion by which an arm may be behind, beyond the lag that was learnt
_LAGS = 0.2  # [s] at most, as docs/arm_contract.md allows
_LASTS = 0.1  # [s] for which it has to be further behind
_MOVES, _NEAR, _PATIENCE = 2e-4, 1.5e-3, 0.3  # [m], [m], [s]: so little an arm moves that stands, away from its command


class RecentSpeed:
    """The command's speeds of late, linear [m/s] and angular [rad/s]: how far an arm that follows may be behind."""

    def __init__(self) -> None:
        self._linear = self._angular = 0.0

    def update(self, v: Vector3, w: Vector3, lag: float, dt: float) -> None:
        """A step of dt [s] at velocity v [m/s] and angular velocity w [rad/s]; lag [s]: by which the arm trails."""
        kept = exp(-dt / min(max(lag, _TRAILS), _LAGS))  # an arm that trails arrives as slowly
        self._linear, self._angular = max(norm(v), self._linear * kept), max(norm(w), self._angular * kept)

    def way(self, lag: float) -> tuple[float, float]:
        """What an arm is behind at most [m], [rad] that is known to trail by a lag [s]."""
        time = min(lag, _LAGS) + _TRAILS
        return time * self._linear, time * self._angular


class Behind(NamedTuple):
    """How far the arm is from its command.

    Attributes:
        place: (3,) [m] of C in the base, where the arm has it.
        distance: [m] of C from where it is commanded. angle: [rad], likewise.
        trail, trail_angle: [m], [rad] of both that motion explains.
    """

    place: Vector3
    distance: float
    angle: float
    trail: float
    trail_angle: float

    def beyond(self, distance: float, angle: float) -> bool:
        """Whether the arm is further away than these [m], [rad], and no motion of the command explains it."""
        return not (self.distance <= distance + self.trail and self.angle <= angle + self.trail_angle)


class ArmFollows:
    """`update` at every step while set-points are followed."""

    def __init__(self, distance: float, angle: float) -> None:
        """distance, angle: [m], [rad] by which command and arm may differ at rest."""
        self._distance, self._angle = distance, angle
        self.restart()

    def restart(self) -> None:
        """The command starts anew from where the arm is."""
        self._behind = 0.0  # [s]
        self._stands_at, self._stands = (inf, inf, inf), 0.0  # [m], [s] since when the arm has not moved

    def update(self, behind: Behind, dt: float) -> str:
        """Take in where the arm is, a step of dt [s] after the last; why to hold, or ''."""
        went = minus(behind.place, self._stands_at)
        self._stands += dt
        if not dot(went, went) < _MOVES * _MOVES or behind.distance < _NEAR:
            self._stands_at, self._stands = behind.place, 0.0
        if self._stands <= _PATIENCE and not behind.beyond(self._distance, self._angle):
            self._behind = 0.0
            return ""
        self._behind += dt
        if self._behind < _LASTS and self._stands <= _PATIENCE:
            return ""
        return (
            f"the arm does not follow: it is {1e3 * behind.distance:.1f} mm and {degrees(behind.angle):.1f} degrees "
            f"from its command (max_tracking_error = {1e3 * self._distance:g} mm, max_angular_tracking_error = "
            f"{degrees(self._angle):g} degrees): see why the driver holds or is slowed down, resume it, then enable"
        )
