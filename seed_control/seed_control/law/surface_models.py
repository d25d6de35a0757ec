# SPDX-License-Identifier: Apache-2.0
"""How a surface may move in time while a tool presses on it: not at all, on at its speed, or to and fro.

Each model has a displacement u, its speed v and, where it swings, a change q of its frequency:

    rests:  u = 0        drifts:  u' = v, v' = noise        swings:  u' = v, v' = -(w + q)^2 u + noise

Several swings of different frequency and steadiness cover what tables do; each finds its own frequency. All models
are carried on together, as arrays whose first axis is the model.
"""

from math import pi, sqrt

import numpy as np

from seed_core.spatial import Array

_RATES = (0.35, 0.6, 1.0, 1.7, 2.9, 4.9)  # [Hz] in equal ratios; each model reaches halfway to the next
_STEADINESS = (4e-4, 2e-3)  # [m/sqrt(s)] by which the displacement of a swing changes beside the swing itself
_REACH, _FURTHEST = 0.15, 0.3  # deviation of a frequency at first, and its largest change, as shares of it
_WANDERS = 0.02  # [1/sqrt(s)] of a frequency, as a share of it
_SWING = 3e-3  # [m] deviation of a swing's displacement at first
_DRIFT, _PUSHED = 8e-3, 5e-3  # [m/s] deviation of a drift's speed at first, [m/s per sqrt(s)] by which it changes
SIZE = 3  # u, v, q
RESTING = 3  # models


class SurfaceModels:
    """The transitions of (u, v, q) for every model; the first three rest (plane, soft, steep), then one drifts.

    Attributes:
        count: of models.
    """

    def __init__(self) -> None:
        rates = [(2.0 * pi * f, a) for a in _STEADINESS for f in _RATES]
        self._w = np.array([0.0] * (RESTING + 1) + [w for w, _ in rates])  # [rad/s]
        self.count = len(self._w)
        self._swings = self._w > 0.0
        self._drifts = np.arange(self.count) == RESTING
        a = np.array([0.0] * (RESTING + 1) + [a for _, a in rates])
        self._noise = np.where(self._drifts, _PUSHED**2, np.square(sqrt(2.0) * self._w * a))  # [m^2/s^3] of v'

    def prior(self) -> Array:
        """(count, 3, 3) covariance of u, v, q at first contact."""
        u = self._swings * _SWING
        v = np.where(self._drifts, _DRIFT, self._w * _SWING)
        return np.stack([np.diag(d) for d in np.square(np.stack([u, v, _REACH * self._w], axis=1))])

    def after(self, motion: Array, dt: float) -> tuple[Array, Array]:
        """Displacement (count,) [m] and speed (count,) [m/s] a time dt [s] after motion (count, 3)."""
        u, v = motion[:, 0], motion[:, 1]
        w, c, s = self._turned(motion[:, 2], dt)
        return c * u + self._by_speed(w, s, dt) * v, c * v - w * s * u

    def transition(self, motion: Array, dt: float) -> Array:
        """(count, 3, 3) derivative of the motion a time dt [s] later by the motion (count, 3) now."""
        u, v = motion[:, 0], motion[:, 1]
        w, c, s = self._turned(motion[:, 2], dt)
        F = np.zeros((self.count, SIZE, SIZE))
        F[:, 0, 0] = F[:, 1, 1] = c
        F[:, 0, 1], F[:, 1, 0] = self._by_speed(w, s, dt), -w * s
        by_frequency = np.where(self._swings, (dt * c - s / np.where(self._swings, w, 1.0)), 0.0)
        F[:, 0, 2] = by_frequency * v / np.where(self._swings, w, 1.0) - dt * s * u
        F[:, 1, 2] = -(s + w * dt * c) * u - dt * s * v
        F[:, 2, 2] = 1.0
        return F

    def noise(self, dt: float) -> Array:
        """(count, 3, 3) covariance that a time dt [s] adds."""
        Q = np.zeros((self.count, SIZE, SIZE))
        Q[:, 0, 0], Q[:, 1, 1] = self._noise * dt**3 / 3.0, self._noise * dt
        Q[:, 0, 1] = Q[:, 1, 0] = self._noise * dt**2 / 2.0
        Q[:, 2, 2] = np.square(_WANDERS * self._w) * dt
        return Q

    def bounded(self, change: Array) -> Array:
        """A change of frequency (count,) [rad/s] within its bounds."""
        most = _FURTHEST * self._w
        return np.clip(change, -most, most)

    def _turned(self, change: Array, dt: float) -> tuple[Array, Array, Array]:
        """Frequency, and cosine and sine of its angle after dt; sine zero where nothing swings."""
        w = self._w + self.bounded(change)
        return w, np.cos(w * dt), np.sin(w * dt)

    def _by_speed(self, w: Array, s: Array, dt: float) -> Array:
        """Displacement after dt by speed [s]."""
        return np.where(self._swings, s / np.where(self._swings, w, 1.0), self._drifts * dt)
