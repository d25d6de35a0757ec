# SPDX-License-Identifier: Apache-2.0
"""What weight and arm reading say the wrench model is off by: a Kalman filter of an offset and a scale per force axis.

    reference - told = b + s * f          x = [b (6): torque, force; s (3): share of each force component f]

b is what a wrong zero does (a pose that is off, a grasp that was taken under load), s what a wrong stiffness does. In
free space the two look alike until the arm turns; pressing tells them apart where the arm has a reading. The priors
decide what cannot be told. Nothing is corrected before it is significant, so a wrench that agrees stays as it is.
"""

from math import inf

import numpy as np

from seed_control.wrench.estimate import low_pass_share
from seed_core.spatial import Array, Wrench, length
from seed_core.wrench_settings import ReferenceSettings

_PRIOR = np.array((0.1, 0.1, 0.1, 0.6, 0.6, 0.6, 0.1, 0.1, 0.1)) ** 2  # [N m, N, 1]
_WALK = np.array((2e-3, 2e-3, 2e-3, 0.02, 0.02, 0.02, 5e-3, 5e-3, 5e-3)) ** 2  # per second
_SET_BACK = 1.0  # [s] by which a sample is older than another only where the clock was set back
_SLOWLY = 0.6  # [s] in which a correction comes in
_CORRELATION = 3.0  # how many times longer than a sample's distance errors stay alike
_LEAST_SCALE = 0.5  # that a load is divided by
_NOTHING = 1e-3  # of a correction that has gone
_NO_SHARE = 1e-6
_LEVER = 0.1  # [m] over which a force of that bound makes the torque's
_BEGIN, _END = 3.5, 2.0  # standard deviations at which a correction begins and ends


class Correction:
    """`learn` from each comparison, `advance` ten times a second, `wrench` tells per image what to add.

    Attributes:
        active: it is significant, and corrects.
    """

    def __init__(self, settings: ReferenceSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """A new grasp: nothing is known of it."""
        self._x, self._P = np.zeros(9), np.diag(_PRIOR)
        self._used = np.zeros(9)  # of x, as far as it has come in
        self._stamp = self._at = -inf
        self._systematic = np.zeros((6, 6))
        self.active = False

    def rescale(self, ratio: Array) -> None:
        """The model tells ratio (3,) times as much force along x, y and z of T from now on.

        What was learnt of the load stays true, so it is another share of what is told; a share of which nothing was
        learnt stays 0.
        """
        learnt = 1.0 - self._P.diagonal()[6:] / _PRIOR[6:]
        before, now = self._x[6:], self._x[6:] / ratio + learnt * (1.0 / ratio - 1.0)
        come_in = np.divide(self._used[6:], before, out=np.zeros(3), where=np.abs(before) > _NO_SHARE)
        self._x, self._used = self._x.copy(), self._used.copy()
        self._x[6:], self._used[6:] = now, np.clip(come_in, 0.0, 1.0) * now

    def learn(self, stamp: float, told: Array, reference: Array, random: Array, systematic: Array) -> None:
        """Take in one comparison of (torque, force) on the tool about T's origin, in T.

        Args:
            stamp: [s].
            told, reference: (6,) [N m, N] as the model tells it, and as it should be.
            random, systematic: (6, 6) covariances of their difference.
        """
        dt = min(max(stamp - self._stamp, 0.0), 1.0) if self._stamp > -inf else 0.0
        newest = -inf if stamp < self._stamp - _SET_BACK else self._stamp  # samples of two kinds take turns
        self._stamp, self._systematic = max(stamp, newest), systematic
        P = self._P + dt * np.diag(_WALK)
        P = np.where(np.eye(9, dtype=bool), np.minimum(P, np.diag(_PRIOR)), P)
        # The load by the reference, not as told: noise of what is told would pass for a scale that is too large.
        load = (reference[3:] - self._x[3:6]) / np.maximum(1.0 + self._x[6:], _LEAST_SCALE)
        H = _rows(np.concatenate((told[:3], load)))
        PHt = P @ H.T
        S = H @ PHt + _CORRELATION * random + systematic
        gain = np.linalg.solve(S, PHt.T).T
        self._x = self._x + gain @ (reference - told - H @ self._x)
        P = P - gain @ PHt.T
        self._P = 0.5 * (P + P.T)

    def mismatch(self, told: Array) -> tuple[Array, Array]:
        """What the model is off by (6,) at a wrench that it tells (6,), with covariance (6, 6)."""
        H = _rows(told)
        return H @ self._x, H @ self._P @ H.T + self._systematic

    def advance(self, stamp: float, told: Array) -> None:
        """Let the correction come in or go, at time stamp [s] and a wrench (6,) that the model tells."""
        dt, self._at = min(max(stamp - self._at, 0.0), 0.2), stamp
        if self._stamp == -inf:
            return
        d, C = self.mismatch(told)
        ratio = float(np.max(np.abs(d) / np.sqrt(np.maximum(C.diagonal(), 1e-12))))
        self.active = self._settings.correct and ratio > (_END if self.active else _BEGIN)
        if self.active:
            self._used = self._used + low_pass_share(dt, _SLOWLY) * (self._x - self._used)
        elif self._used.any():
            self._used = self._used * (1.0 - low_pass_share(dt, _SLOWLY))
            if float(np.abs(self._used).max()) < _NOTHING:
                self._used = np.zeros(9)

    def wrench(self, told: Wrench) -> Wrench | None:
        """What to add to a wrench that the model tells, about T in T; None while nothing is corrected."""
        if not self._used.any():
            return None
        v = told.vector()
        return Wrench.from_vector(self._bounded(_rows(v) @ self._used, v))

    def _bounded(self, d: Array, told: Array) -> Array:
        s = self._settings
        bound = s.correction_offset + s.correction_share * length(told[3:])
        size = length(d[3:])
        turning = length(d[:3])
        out: Array = d.copy()
        out[3:] *= min(1.0, bound / max(size, 1e-9))
        out[:3] *= min(1.0, _LEVER * bound / max(turning, 1e-9))
        return out


def _rows(told: Array) -> Array:
    """(6, 9) of the mismatch by [b, s]."""
    H = np.zeros((6, 9))
    H[:6, :6] = np.eye(6)
    H[3, 6], H[4, 7], H[5, 8] = told[3], told[4], told[5]
    return H
