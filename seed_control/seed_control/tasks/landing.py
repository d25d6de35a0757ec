# SPDX-License-Identifier: Apache-2.0
"""Where a tip lands that is pressed on one place.

Friction holds it there: a reference beside it would be pushed for in vain, and what a gripper presses sideways against
friction moves the tip all at once as soon as it slides. So the reference moves to where the tip is.
"""

import numpy as np

from seed_core.spatial import Array, length

_STANDS = 1e-3  # [m] of a path across the force that is none
_LONG, _FEWEST = 0.5, 8  # [s] of contact, images, in which the tip is seen where it has landed
_MOST = 5e-3  # [m] that it may lie beside its place


class Landing:
    """`step` with each control step, `image` with each image after it; all in the work frame.

    Attributes:
        beside: (3,) [m] by which the tip has landed beside its place, across the force.
    """

    def __init__(self, place: Array, force_projector: Array) -> None:
        """place: (3,) [m] where it is to stand. force_projector: (3, 3) onto the force directions."""
        self._place, self._across = place, np.eye(3) - force_projector
        self._places: list[Array] = []  # of the tip (3,) [m] in the images since it landed
        self._since = 0.0  # [s] that it touches
        self._looks: bool | None = None  # at where the tip is, once it touches; None before the first step
        self.beside = np.zeros(3)

    def stands(self, points: Array) -> bool:
        """Whether a path over points (n, 3) [m] stays at the place, but for its way along the force."""
        over = (points - self._place) @ self._across
        return bool(np.all(np.sum(over**2, axis=1) < _STANDS**2))

    def step(self, dt: float, touches: bool) -> None:
        """Go on by dt [s]; one that touches from the first step on has not landed here."""
        if self._looks is None:
            self._looks = not touches
        if self._looks and touches:
            self._since += dt
            self._looks = self._since < _LONG

    def image(self, tip: Array, touches: bool) -> None:
        """Take in where the tip (3,) [m] is in a new image."""
        if not (self._looks and touches):
            return
        self._places.append(tip)
        if len(self._places) >= _FEWEST:
            beside = self._across @ (np.mean(self._places, axis=0) - self._place)
            self.beside = beside * min(_MOST / max(length(beside), 1e-12), 1.0)
