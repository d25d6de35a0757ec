# SPDX-License-Identifier: Apache-2.0
"""Where the surface is under the tip, and will be: a bank of Kalman filters along one force direction.

Along the unit vector n, with c the height at which the tip would be if the grasp were not deflected (kinematics), y the
measured height of the tip, s the tip's position across n, and c0 the value of c at first contact:

    y = zeta + g . (s - s0) + u(t) + beta (c - c0) + e c'

beta = k / (k + k_env) is the share of gripper motion that the tip follows, and e [s] by how much images are dated late:
then y is off by as far as the gripper has gone since. Left out, that would pass for a surface that moves as the gripper
does. The model is linear in [zeta, g (3), beta, e, u], since c is known from kinematics. u is how the surface moves in
time: one filter for each of `SurfaceModels`, weighted by how well each has foretold the images.
A surface that rests is all but always the likeliest, and then the bank is the one filter of a plane. One of those that
rest expects soft ground: what gives way as it is pressed would else look as if it sank by itself. One expects steep
ground: a plane that is believed to be nearly level trails behind a slope until many images have told it.

The wanted deflection d = c - y along n then needs

    c = c0 + (zeta + g . (s - s0) + u - c0 + d) / (1 - beta)

at the place where the tip will be, at the time when it will be there. Heights are counted from an anchor that moves
with the tip, so that a force direction that turns with a surface does no harm.
"""

from math import exp

import numpy as np

from seed_control.law.surface_models import RESTING, SurfaceModels
from seed_control.parameters import ControllerParameters
from seed_core.spatial import Array
from seed_core.vector3 import Vector3, as_vector3, dot, plus_scaled

MAX_SHARE = 0.85  # of beta: beyond it the environment gives way more than the grasp and 1 / (1 - beta) is mostly noise
_GATE = 9.0  # squared innovation over its variance (3 sigma)
_HEIGHT_PRIOR = 2e-3  # [m], deviation at first contact
_JUMP_IMAGES = 2  # so many in a row on one side mean that the surface has stepped
_FORGET = 20.0  # [s] in which the weights would come back to what they were at first
_LATE, _LATE_WALK = 0.03, 0.01  # [s] deviation of the images' stamps at first, and [s/sqrt(s)] of its change
_MOVING_WALK = 5e-5  # [m/sqrt(s)] of the height of a surface whose motion is modelled
_MOTION = slice(6, 9)  # of the state
_SOFT, _SOFT_SHARE = 0.4, 0.1  # deviation of beta on soft ground, and how likely that is at first
_STEEP, _STEEP_SHARE = 0.15, 0.1  # the same of the slope on steep ground
_SIZE = 9
_STATED_IMAGES, _NOISE_IMAGES = 15, 60  # that the stated variance is worth at first, and that the level is a mean of


class NoiseLevel:
    """White noise of the heights, from their second differences: what an estimate states may be too small."""

    def __init__(self) -> None:
        self._rise: float | None = None
        self._variance, self._images = 0.0, 0

    def update(self, rise: float, stated: float) -> float:
        """Take in the rise [m] from one image to the next; the variance [m^2] to count with."""
        if self._rise is None:
            self._variance, self._images = stated, _STATED_IMAGES
        else:
            self._images, bend = min(self._images + 1, _NOISE_IMAGES), rise - self._rise
            self._variance += (bend * bend / 6.0 - self._variance) / self._images
        self._rise = rise
        return max(stated, self._variance)


class SurfaceObserver:
    """The bank along one direction. `start` at first contact, `update` and `wanted_height` per image.

    Attributes:
        weights: of the models, the first three of which rest.
        anchor: (3,) [m] in W; heights are counted from it.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        p = parameters
        self._models = models = SurfaceModels()
        self._walk = np.zeros((models.count, _SIZE))  # of the state, per second
        self._walk[:, 0] = _MOVING_WALK**2
        self._walk[: RESTING + 1, 0] = (1e-3 * p.surface_noise) ** 2
        self._walk[:, 1:4] = p.slope_noise**2
        self._walk[:, 5] = _LATE_WALK**2
        self._prior = np.zeros((models.count, _SIZE, _SIZE))
        fixed = [_HEIGHT_PRIOR, *[p.slope_prior] * 3, p.compliance_prior, _LATE]
        self._prior[:, range(6), range(6)] = np.square(fixed)
        self._prior[:, _MOTION, _MOTION] = models.prior()
        self._prior[1, 4, 4] = _SOFT**2
        self._prior[2, range(1, 4), range(1, 4)] = max(_STEEP, p.slope_prior) ** 2
        self._first_weights = np.full(models.count, p.moving_surface / (models.count - RESTING))
        shares = np.array((1.0 - _SOFT_SHARE - _STEEP_SHARE, _SOFT_SHARE, _STEEP_SHARE))
        self._first_weights[:RESTING] = shares * (1.0 - p.moving_surface)
        self.weights = self._first_weights
        self._x, self._P = np.zeros((models.count, _SIZE)), self._prior
        self._noise = NoiseLevel()
        self.anchor = self._undeflected = np.zeros(3)
        self._c0 = self._last = 0.0
        self._outside = 0

    @property
    def x(self) -> Array:
        """(9,) weighted mean of height zeta [m], slope g (3): rise along n per metre, share beta, e [s], the motion."""
        mean: Array = self.weights @ self._x
        return mean

    def start(self, t: float, n: Array, tip: Array, undeflected: Array) -> None:
        """First contact at time t [s]: force direction n, measured tip and undeflected tip, each (3,) [m] in W."""
        self._x, self._P = np.zeros_like(self._x), self._prior.copy()
        self.weights, self._noise = self._first_weights, NoiseLevel()
        self.anchor = tip.copy()
        self._c0, self._last, self._outside = float(n @ (undeflected - tip)), t, 0
        self._undeflected = undeflected.copy()

    def update(self, t: float, n: Array, tip: Array, undeflected: Array, variance: float) -> float:
        """Take in one image.

        Args:
            t: [s] of the image.
            n: (3,) force direction. tip, undeflected: (3,) [m] in W, measured tip and undeflected tip.
            variance: [m^2] of the measured height.

        Returns:
            The innovation [m].
        """
        dt = max(t - self._last, 0.0)
        rise = self._predict(dt, n, tip)
        self._last = t
        variance = self._noise.update(rise, variance)
        h = np.zeros(_SIZE)
        h[0] = h[6] = 1.0
        h[4], h[5] = float(n @ (undeflected - tip)) - self._c0, self._speed(n, undeflected, dt)
        innovations = -(self._x @ h)  # the anchor is the measured tip: y = 0
        Ph = self._P @ h
        totals = Ph @ h + variance
        best = int(self.weights.argmax())
        if self._stepped(float(innovations[best]), float(totals[best])):
            self._P[:, 0, 0] += np.square(innovations)
            Ph = self._P @ h
            totals = Ph @ h + variance
        gains = Ph / totals[:, None]
        self._x += gains * innovations[:, None]
        self._P -= gains[:, :, None] * Ph[:, None, :]
        self._bound()
        innovation = float(self.weights @ innovations)
        self._weigh(np.square(innovations) / totals, totals)
        return innovation

    def wanted_height(self, n: Vector3, deflection: float, ahead: float = 0.0) -> tuple[float, Vector3, float]:
        """Height c along n at which c - y is the deflection [m] wanted, wherever the tip is going to be.

        Args:
            ahead: [s] after the newest image's stamp for which it is wanted.

        Returns:
            Offset [m], gradient (3,) and rate [m/s]: with the tip at (3,) in W, c = offset + gradient . tip, and the
            offset rises at that rate.
        """
        x, place = self._x, as_vector3(self.anchor)
        moved, speed = self._models.after(x[:, _MOTION], ahead)
        gain = self.weights / (1.0 - x[:, 4])
        start = self._c0 + float(gain @ (x[:, 0] + moved - self._c0 + deflection))
        g = as_vector3(gain @ x[:, 1:4])
        gradient = plus_scaled(g, -dot(g, n), n)  # across n
        return dot(n, place) + start - dot(gradient, place), gradient, float(gain @ speed)

    def tilt(self, slope: Array, share: float) -> None:
        """Slope (3,) and share beta are known from elsewhere: `surface_normal.py` tells them better than heights alone.

        Then what rises under the tool is the surface's shape: nothing counts as moving in time. Under a gripper that
        stays, a tip that goes up a soft surface rises by less than its slope.
        """
        self._x[:, 1:4], self._x[:, 4] = (1.0 - share) * slope, share
        self._P[:, 1:5, :] = self._P[:, :, 1:5] = 0.0
        self._x[:, _MOTION] = 0.0
        rest = (self.weights + 1e-12) * (np.arange(len(self.weights)) < RESTING)
        self.weights = rest / rest.sum()

    def lie(self, height: float, n: Array, undeflected: Array) -> None:
        """So is the surface's height [m] along n from the anchor, under the gripper's present push."""
        self._x[:, 0] = height - self._x[:, 4] * (float(n @ (undeflected - self.anchor)) - self._c0)

    def _speed(self, n: Array, undeflected: Array, dt: float) -> float:
        """Of the undeflected tip along n [m/s], dt [s] after the image before."""
        way, self._undeflected = undeflected - self._undeflected, undeflected
        return float(n @ way) / dt if dt > 0.0 else 0.0

    def _predict(self, dt: float, n: Array, tip: Array) -> float:
        """Carry the estimates on by dt [s] to the new place, and count heights from there; the rise [m] of the tip."""
        step = tip - self.anchor
        rise = float(n @ step)
        x, models = self._x, self._models
        F = np.zeros((models.count, _SIZE, _SIZE))
        F[:, range(6), range(6)] = 1.0
        F[:, 0, 1:4] = across = step - rise * n
        F[:, _MOTION, _MOTION] = models.transition(x[:, _MOTION], dt)
        x[:, 0] += x[:, 1:4] @ across - rise
        x[:, 6], x[:, 7] = models.after(x[:, _MOTION], dt)
        self._c0 -= rise
        self._P = F @ self._P @ F.transpose(0, 2, 1)
        self._P[:, range(_SIZE), range(_SIZE)] += dt * self._walk
        self._P[:, _MOTION, _MOTION] += models.noise(dt)
        fade = 1.0 - exp(-dt / _FORGET)
        self.weights = (1.0 - fade) * self.weights + fade * self._first_weights
        self.anchor = tip.copy()
        return rise

    def _bound(self) -> None:
        """Bring share and frequency back within their bounds, and with them all else as the covariance ties it to them.

        A value cut off alone would put the height off by many of its deviations; a filter that is sure of the height
        then throws everything else after it (estimate projection: Simon, IET Control Theory Appl. 4(8), 2010, sec. 3).
        """
        self._hold(8, self._models.bounded(self._x[:, 8]))
        self._hold(4, np.clip(self._x[:, 4], 0.0, MAX_SHARE))

    def _hold(self, i: int, value: Array) -> None:
        """Put state i to these values (count,), the others to their means given that."""
        beyond = value - self._x[:, i]
        if beyond.any():
            steps = np.divide(beyond, self._P[:, i, i], out=np.zeros_like(beyond), where=self._P[:, i, i] > 0.0)
            self._x += self._P[:, :, i] * steps[:, None]
            self._x[:, i] = value

    def _weigh(self, squares: Array, totals: Array) -> None:
        """Weights by the likelihood of normalised squared innovations (count,) of those variances [m^2]."""
        likelihood = np.exp(-0.5 * (squares - squares.min())) / np.sqrt(totals)
        weights = self.weights * likelihood
        self.weights = weights / weights.sum()

    def _stepped(self, innovation: float, variance: float) -> bool:
        side = 1 if innovation > 0 else -1
        if innovation * innovation < _GATE * variance:
            self._outside = 0
            return False
        self._outside = self._outside + side if self._outside * side >= 0 else side
        return abs(self._outside) >= _JUMP_IMAGES
