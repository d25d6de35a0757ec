# SPDX-License-Identifier: Apache-2.0
"""How far the arm trails its command, measured while it moves."""

from __future__ import annotations

from seed_core.vector3 import Vector3

_FORGET = 2.0  # [s] of motion
_GUESS = 0.05**2 * 0.2  # [m^2/s]; the first guess weighs as much as 0.2 s at 50 mm/s
_STILL = 2e-3  # [m/s]; slower motion says nothing


class LagEstimate:
    """Regression of command minus measured position on the command's velocity: lag [s], for steady motion."""

    def __init__(self, guess: float) -> None:
        self._top, self._bottom = guess * _GUESS, _GUESS
        self.lag = guess

    def update(self, command: Vector3, measured: Vector3, velocity: Vector3, dt: float) -> None:
        """One step: commanded and measured position [m], velocity of the command [m/s]."""
        (u, v, w), (a, b, c), (x, y, z) = velocity, command, measured
        square = u * u + v * v + w * w
        if square < _STILL * _STILL:
            return
        keep = 1.0 - min(square / 0.05**2, 1.0) * dt / _FORGET
        self._top = keep * self._top + dt * ((a - x) * u + (b - y) * v + (c - z) * w)
        self._bottom = keep * self._bottom + dt * square
        self.lag = min(max(self._top / self._bottom, 0.0), 0.3)
