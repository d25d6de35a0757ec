# SPDX-License-Identifier: Apache-2.0
"""Where the surface is under the tip: a Kalman filter of its height, slope and compliance, along one force direction.

Along the unit vector n, with c the height at which the tip would be if the grasp were not deflected (kinematics), y the
measured height of the tip, s the tip's position across n, and c0 the value of c at first contact:

    y = zeta + g . (s - s0) + beta (c - c0)            beta = k / (k + k_env): share of gripper motion the tip follows

The model is linear in x = [zeta, g (3), beta], since c is known from kinematics. The wanted deflection d = c - y along
n then needs

    c = c0 + (zeta + g . (s - s0) - c0 + d) / (1 - beta)

which depends on where the tip will be, not on when: the image's age does not enter. Heights are counted from an anchor
that moves with the tip, so that a force direction that turns with a surface does no harm.
"""

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_core.spatial import Array
from seed_core.vector3 import Vector3, as_vector3, dot, plus_scaled

MAX_SHARE = 0.85  # of beta: beyond it the environment gives way more than the grasp and 1 / (1 - beta) is mostly noise
_GATE = 9.0  # squared innovation over its variance (3 sigma)
_HEIGHT_PRIOR = 2e-3  # [m], deviation at first contact
_JUMP_IMAGES = 2  # so many in a row on one side mean that the surface has stepped


class SurfaceObserver:
    """The filter along one direction. `start` at first contact, `update` and `wanted_height` per image.

    Attributes:
        x: (5,) height zeta [m], slope g (3): rise along n per metre of travel, and share beta.
        P: (5, 5) its covariance.
        anchor: (3,) [m] in W; heights are counted from it.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        p = parameters
        self._walk = np.diag(np.square([1e-3 * p.surface_noise, *[p.slope_noise] * 3, 0.0]))  # of x, per second
        self._prior = np.square([_HEIGHT_PRIOR, *[p.slope_prior] * 3, p.compliance_prior])
        self.x = np.zeros(5)
        self.P = np.eye(5)
        self.anchor = np.zeros(3)
        self._c0 = self._last = 0.0
        self._outside = 0

    def start(self, t: float, n: Array, tip: Array, undeflected: Array, share: float = 0.0) -> None:
        """First contact at time t [s]: force direction n, measured tip and undeflected tip, each (3,) [m] in W."""
        self.x[:] = (0.0, 0.0, 0.0, 0.0, share)
        self.P = np.diag(self._prior)
        self.anchor = tip.copy()
        self._c0, self._last, self._outside = float(n @ (undeflected - tip)), t, 0

    def update(self, t: float, n: Array, tip: Array, undeflected: Array, variance: float) -> float:
        """One image at time t, variance [m^2] of the measured height. Returns the innovation [m]."""
        self._predict(t, n, tip)
        h = np.array((1.0, 0.0, 0.0, 0.0, float(n @ (undeflected - tip)) - self._c0))
        Ph = self.P @ h
        innovation = -float(h @ self.x)  # the anchor is the measured tip: y = 0
        total = float(h @ Ph) + variance
        if self._stepped(innovation, total):
            self.P[0, 0] += innovation * innovation
            Ph = self.P @ h
            total = float(h @ Ph) + variance
        gain = Ph / total
        self.x += gain * innovation
        self.x[4] = min(max(self.x[4], 0.0), MAX_SHARE)
        self.P -= gain[:, None] * Ph
        return innovation

    def wanted_height(self, n: Vector3, deflection: float) -> tuple[float, Vector3]:
        """Height c along n at which c - y is the deflection [m] wanted, wherever the tip is going to be.

        Returns offset [m] and gradient (3,): with the tip at (3,) in W, c = offset + gradient . tip.
        """
        height, *g, share = self.x.tolist()
        gain, place = 1.0 / (1.0 - share), as_vector3(self.anchor)
        x, y, z = plus_scaled(g, -dot(g, n), n)  # across n
        gradient = gain * x, gain * y, gain * z
        start = self._c0 + gain * (height - self._c0 + deflection)
        return dot(n, place) + start - dot(gradient, place), gradient

    def tilt(self, slope: Array) -> None:
        """The slope (3,) is known from elsewhere: `surface_normal.py` tells it better than heights alone."""
        self.x[1:4] = slope
        self.P[1:4, :] = self.P[:, 1:4] = 0.0

    def lie(self, height: float, n: Array, undeflected: Array) -> None:
        """So is the surface's height [m] along n from the anchor, under the gripper's present push."""
        self.x[0] = height - self.x[4] * (float(n @ (undeflected - self.anchor)) - self._c0)

    def _predict(self, t: float, n: Array, tip: Array) -> None:
        """Carry the estimate to the new place, and count heights from there."""
        step, dt = tip - self.anchor, max(t - self._last, 0.0)
        rise = float(n @ step)
        F = np.eye(5)
        F[0, 1:4] = step - rise * n
        self.x[0] = F[0] @ self.x - rise
        self._c0 -= rise
        self.P = F @ self.P @ F.T
        self.P += dt * self._walk
        self.anchor = tip.copy()
        self._last = t

    def _stepped(self, innovation: float, variance: float) -> bool:
        side = 1 if innovation > 0 else -1
        if innovation * innovation < _GATE * variance:
            self._outside = 0
            return False
        self._outside = self._outside + side if self._outside * side >= 0 else side
        return abs(self._outside) >= _JUMP_IMAGES
