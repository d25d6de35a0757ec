# SPDX-License-Identifier: Apache-2.0
"""A way that was gone in search of something, while other set-points are followed.

A client that alternates between a search and a place would else begin the way anew each time, and go on and on.
"""

from seed_core.vector3 import ZERO, Vector3, dot, norm, plus, plus_scaled

_COASTS = 0.1  # [s] for which the search's own speed goes on


class LeftWay:
    """`leave` when the search ends, `move` with each motion by a place that was asked for.

    Such a motion takes back what it goes back. One as long as the bound is a new place, where a new search may begin.

    Attributes:
        gone: (3,) [m], or [rad] of a turn, that counts when the search goes on.
    """

    def __init__(self, bound: float) -> None:
        """bound: [m] or [rad] of the search."""
        self._bound = bound
        self.forget()

    def forget(self) -> None:
        """It was found, or motion is allowed anew."""
        self.leave(ZERO)

    def leave(self, gone: Vector3) -> None:
        """Something else is followed from now on."""
        self.gone, self._own, self._time = gone, ZERO, 0.0

    def move(self, step: Vector3, dt: float) -> None:
        """A step (3,) of dt [s] to a place that was asked for."""
        size = norm(self.gone)
        if not size:
            return
        self._own, self._time = plus(self._own, step), self._time + dt
        along = dot(step, self.gone) / size
        if along < 0.0 or self._time <= _COASTS:
            self.gone = plus_scaled(self.gone, max(along, -size) / size, self.gone)
        if norm(self._own) >= self._bound:
            self.forget()
