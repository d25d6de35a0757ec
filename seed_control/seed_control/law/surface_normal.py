# SPDX-License-Identifier: Apache-2.0
"""The surface's normal, found while the tool moves: a Kalman filter of slope, bend, friction and give under the tip.

At the anchor (the tip of the newest image) the surface's height along the present normal n, over the displacement d in
the tangent plane, is

    y(d) = h + a . d + d . S d / 2 - s q           a: slope (2,), S: bend (2, 2), 1/m, its second fundamental form

s q is what the surface gives way by: s for every metre q that the grasp is deflected along n.

A tip that moves by d carries h and a on by this; then n is turned until a is zero. A tip that sticks while the gripper
goes on tells little: what it sinks by as the force is built up would pass for a slope. Three things tell of it:

    the tip's track     y = 0 at every image, for the tip touches the surface
    the force           f = N (a - n + mu v) of the tool on the surface, v the direction of motion: across v friction
                        has no part, so what there is of the force is the slope's; along it friction mu is another
                        unknown, which changes with the way; of a tip that sticks, more than friction can hold is the
                        slope's
    the tool's lean     a line or face that the contact keeps on the surface (`contact_resists`) lies in it

The bend predicts the normal where the tip is going to be: on a cylinder of 80 mm at 50 mm/s it turns by 3 degrees
within a loop time of 80 ms.
"""

from math import exp

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.wrench.estimate import Measurement
from seed_core.spatial import Array, length

_H, _A, _S, _MU, _SOFT, _SIZE = 0, slice(1, 3), slice(3, 6), 6, 7, 8
_HEIGHT, _SLOPE, _BEND = 2e-3, 0.35, 6.0  # [m], [1], [1/m] deviations at first contact
_WALK_HEIGHT = 2e-4  # [m/sqrt(s)]
# [1/sqrt(m)], [1/m/sqrt(m)], [1/sqrt(m)] along the way: surfaces bend and their friction changes by place, not by time
_WALK_SLOPE, _WALK_BEND, _WALK_FRICTION, _WALK_SOFTNESS = 0.03, 16.0, 0.8, 0.1
_SOFTNESS = 0.3  # [1] deviation of the surface's give over the grasp's at first contact
_ANY_FRICTION = 3.0  # [1] deviation of a friction that nothing is known of: it must not pass for a slope
_OFF_ACROSS, _OFF_ALONG = 0.1, 0.03  # of the force that its direction is off by across and along the way, at least
_UNLIKELY = 9.0  # squared innovation over its variance, from which on friction is another
_LEAST_FORCE = 1.0  # [N] whose direction tells anything
_TOUCHES = 0.35  # of the wanted force, below which the tip may be in the air
_ROUGH = 1.5e-4  # [m] deviation of a height, whatever is stated
_LEAST_SPEED = 6e-3  # [m/s] from which on a tip slides
_TOLD, _STILL_TOLD = 3.5, 2.5  # deviations of a speed that make a tip that sticks one that slides; that it still does
_MOST_FRICTION = 0.6  # of a tip that sticks; what leans the force by more is a slope
_SMOOTHING = 0.08  # [s] over which the place along the surface and its speed are smoothed, and the force's direction
_GATE = 16.0  # squared innovation over its variance (4 sigma)
_IN_A_ROW = 3  # of them on one side mean that the surface has an edge here
_OPENED = 0.25  # [1] deviation of the slope after an edge
_FURTHEST = 0.25  # [rad] by which the bend turns the normal ahead, at most
_UPRIGHT = 1e-3  # sine of an axis to the normal, at most, that has no direction along the surface
_STEEPEST = 0.0  # cosine of the normal to the one that was expected before contact, at least


class SurfaceNormal:
    """The filter. `start` at first contact, `image` at every image.

    Attributes:
        n: (3,) unit normal out of the surface, in W, where the tip was at the newest image.
        ahead: (3,) the same where the tip is going to be when the arm answers.
        x: (8,) height [m] from the tip of the newest image, slope (2), bend (xx, xy, yy) [1/m] along `tangents`,
            friction, softness: [m] that the surface gives way by for every metre that the grasp is deflected.
        P: (8, 8) its covariance. tangents: (2, 3) in W.
        running: whether there was contact since it was started.
    """

    def __init__(self) -> None:
        self.x, self.P = np.zeros(_SIZE), np.eye(_SIZE)
        self.expected = self.n = self.ahead = np.array((0.0, 0.0, 1.0))
        self.tangents = np.eye(3)[:2]
        self.anchor = np.zeros(3)
        self.running = False
        self._last = 0.0
        self._outside = np.zeros(4, dtype=int)  # of height, force across, lean, force along
        self._step = np.zeros(2)  # of the last image
        self._velocity = np.zeros(2)  # [m/s] of the tip along the tangents, as images show it
        self._felt = np.zeros(2)  # of the force along the tangents, at the last image
        self._drag = np.zeros(2)  # that less the slope's: friction's, smoothed as the velocity is
        self._pressing = 0.0  # [N] at the last image
        self._deflection = 0.0  # [m] of the grasp along n as foretold: what is seen has the noise of the tip, too
        self._slides = False
        self._going = np.zeros(2)  # to where the tip is going to be

    def expect(self, normal: Array) -> None:
        """What the task says of the normal (3,) in W; taken for true until there is contact."""
        if not self.running:
            self.expected = self.n = self.ahead = normal

    def release(self) -> None:
        """Contact is to be found anew."""
        self.running = False

    def start(self, m: Measurement) -> None:
        """First contact."""
        n = self.n
        e = np.eye(3)[int(np.argmin(np.abs(n)))]
        first = e - (e @ n) * n
        first = first / np.sqrt(first @ first)
        self.tangents = np.array((first, np.cross(n, first)))
        self.x[:] = 0.0
        self.P = np.diag(np.square([_HEIGHT, _SLOPE, _SLOPE, _BEND, _BEND, _BEND, _ANY_FRICTION, _SOFTNESS]))
        self.anchor, self._last, self.running = m.tip.copy(), m.stamp, True
        self._outside[:] = 0
        self._velocity, self._drag = np.zeros(2), np.zeros(2)
        self._slides = False
        self._pressing = -float(n @ m.on_environment.force)

    @property
    def share(self) -> float:
        """Of the gripper's motion along n that the surface gives way by."""
        softness = float(self.x[_SOFT])
        return softness / (1.0 + softness)

    @property
    def height(self) -> float:
        """[m] of the surface along n over the tip of the newest image, under the gripper's present push."""
        return float(self.x[_H] - self.x[_SOFT] * self._deflection)

    def image(self, m: Measurement, s: HybridSetpoint, stiffness: float, loop_time: float) -> None:
        """One image in contact, of a grasp with this mean stiffness [N/m], answered after loop_time [s]."""
        self._predict(m, s)
        if self._pressing < _TOUCHES * length(s.wrench.force):
            self._leave()
        foretold = self.x[_A].copy()
        self._track(m)
        self._lean(m, s)
        if self._slides:
            self._force(m, stiffness, foretold)
        else:
            self._stick()
            self._forget_friction()
        self._drag = self._drag - (self.x[_A] - foretold)  # what was taken for friction was the slope's
        height = self.height
        self._turn(self.x[_A].copy())
        self._deflection = self._deflected(m)
        self.x[_H] += height - self.height  # a normal that turns moves no surface
        self._going = self.tangents @ s.velocity * loop_time
        turn = self._bend() @ self._going
        size = length(turn)
        self.ahead = self._off(turn * min(_FURTHEST / max(size, 1e-9), 1.0))

    def slope(self, behind: bool) -> Array:
        """(3,) in W: the surface's rise per way against `ahead`, half of the last image's way behind it or half of the
        way ahead of it: there a chord has the slope of the surface."""
        place = -0.5 * self._step if behind else 0.5 * self._going
        at = self._off(self._bend() @ place)
        ahead = self.ahead
        return np.asarray(ahead - at / float(at @ ahead))

    def axes(self, R_W_task: Array) -> Array:
        """(3, 3) axes of the task frame: z along `ahead`, x as near to that of R_W_task (3, 3) as can be."""
        z = self.ahead
        x = R_W_task[:, 0] - (R_W_task[:, 0] @ z) * z
        if float(x @ x) < _UPRIGHT**2:  # that one stands on the surface: y tells as well
            x = np.cross(R_W_task[:, 1], z)
        x = x / np.sqrt(x @ x)
        return np.column_stack([x, np.cross(z, x), z])

    def _bend(self) -> Array:
        xx, xy, yy = self.x[_S]
        return np.array(((xx, xy), (xy, yy)))

    def _off(self, slope: Array) -> Array:
        """The normal (3,) of a surface that rises by slope (2,) against n."""
        out = self.n - self.tangents.T @ slope
        return np.asarray(out / np.sqrt(out @ out))

    def _deflected(self, m: Measurement) -> float:
        """[m] of the grasp along n: from where the tip is foretold to where it would be if nothing gave way."""
        return float(self.x[_H] - self.n @ (m.undeflected - m.tip)) / (1.0 + float(self.x[_SOFT]))

    def _predict(self, m: Measurement, s: HybridSetpoint) -> None:
        """To the place of a new image, smoothed along the surface: there the tip moves evenly, or sticks."""
        dt = max(m.stamp - self._last, 1e-3)
        self._last = m.stamp
        force = m.on_environment.force
        self._pressing = pressing = -float(self.n @ force)
        off = m.tip - self.anchor
        rise = float(self.n @ off)
        left = exp(-dt / _SMOOTHING)
        d = self._velocity * dt
        late = self.tangents @ off - d
        self._velocity = self._velocity + (1.0 - left) ** 2 / dt * late
        d = d + (1.0 - left**2) * late
        self.anchor = self.anchor + self.tangents.T @ d + rise * self.n
        self._slides = self._speed(s) > self._least_speed(m, dt)
        if not self._slides:
            d = np.zeros(2)  # what stands still tells nothing of a slope, however its noise moves
        self._step = d
        F = np.eye(_SIZE)
        F[_H, 1:6] = (d[0], d[1], 0.5 * d[0] * d[0], d[0] * d[1], 0.5 * d[1] * d[1])
        F[1, 3:5] = F[2, 4:6] = d
        self.x = F @ self.x
        self.x[_H] -= rise
        way = length(self._velocity) * dt if self._slides else 0.0
        walk = np.zeros(_SIZE)
        self._felt = self.tangents @ force / max(pressing, _LEAST_FORCE)
        felt = self._felt - self.x[_A]
        self._drag = self._drag + (1.0 - exp(-0.5 * dt / _SMOOTHING)) * (felt - self._drag)
        walk[_H] = _WALK_HEIGHT**2 * dt
        walk[_A], walk[_S] = _WALK_SLOPE**2 * way, _WALK_BEND**2 * way
        walk[_MU], walk[_SOFT] = _WALK_FRICTION**2 * way, _WALK_SOFTNESS**2 * way
        self.P = F @ self.P @ F.T + np.diag(walk)

    @staticmethod
    def _noise(m: Measurement) -> float:
        """[m^2] of the tip's place along the surface."""
        lever = m.X_WT[:3, 3] - m.tip
        return m.variance + float(lever @ lever) * m.rotation_deviation**2

    def _leave(self) -> None:
        """A tip that hardly presses flies over a step, or falls: its track is not the surface's."""
        self.x[_H] = 0.0
        self.P[_H, :] = self.P[:, _H] = 0.0
        self.P[_H, _H] = _HEIGHT**2

    def _speed(self, s: HybridSetpoint) -> float:
        """[m/s] of the tip; until it slides, only along the path: noise goes anywhere."""
        speed = length(self._velocity)
        path = self.tangents @ s.velocity
        of_path = length(path)
        if self._slides or of_path < _LEAST_SPEED:
            return speed
        return float(self._velocity @ path) / of_path

    def _least_speed(self, m: Measurement, dt: float) -> float:
        """[m/s] from which on the tip slides: beyond what the noise of its place makes of one that sticks."""
        noise = self._noise(m) * dt / (4.0 * _SMOOTHING**3)
        return max(_LEAST_SPEED, (_STILL_TOLD if self._slides else _TOLD) * float(np.sqrt(noise)))

    def _track(self, m: Measurement) -> None:
        """The tip touches: its height is the surface's."""
        self._deflection = self._deflected(m)
        h = np.zeros(_SIZE)
        h[_H], h[_SOFT] = 1.0, -self._deflection
        if self._slides:  # a tip that comes loose is ahead of where it is smoothed to, by more than its noise
            ahead = self.tangents @ (m.tip - self.anchor)
            x, y = max(1.0 - self._noise(m) / max(float(ahead @ ahead), 1e-12), 0.0) * ahead
            h[1:6] = x, y, 0.5 * x * x, x * y, 0.5 * y * y
        lever = np.cross(self.n, m.X_WT[:3, 3] - m.tip)  # of a tool that leans a turn moves the tip along n, too
        self._correct(0, h, 0.0, m.variance + float(lever @ lever) * m.rotation_deviation**2 + _ROUGH**2)
        if self.x[_SOFT] < 0.0:  # the others to their means given that it is zero: see `SurfaceObserver._bound`
            self.x = self.x - self.P[:, _SOFT] * (self.x[_SOFT] / self.P[_SOFT, _SOFT])

    def _force(self, m: Measurement, stiffness: float, foretold: Array) -> None:
        """The force's direction across the motion and along it; foretold: slope (2,) at this place."""
        pressing, v = self._pressing, self._velocity
        if pressing < _LEAST_FORCE:
            return
        along = v / np.sqrt(v @ v)
        across = np.array((-along[1], along[0]))
        h = np.zeros(_SIZE)
        h[_A] = across
        noise = stiffness**2 * m.variance / pressing**2
        self._correct(1, h, float(across @ (self._drag + foretold)), noise + _OFF_ACROSS**2)
        h = np.zeros(_SIZE)
        h[_A], h[_MU] = along, 1.0
        seen, variance = float(along @ self._felt), noise + _OFF_ALONG**2
        off = seen - float(h @ self.x)
        if off * off > _UNLIKELY * (float(h @ self.P @ h) + variance):
            self._forget_friction()
        self._correct(3, h, seen, variance)

    def _forget_friction(self) -> None:
        """A tip that sticks feels any share of it, and one that comes onto other material another."""
        self.P[_MU, :] = self.P[:, _MU] = 0.0
        self.P[_MU, _MU] = _ANY_FRICTION**2

    def _stick(self) -> None:
        """The slope, where the force of a tip that sticks leans by more than friction can hold."""
        leans = length(self._drag)
        if leans > _MOST_FRICTION:
            h = np.zeros(_SIZE)
            h[_A] = self._drag / leans
            Ph = self.P @ h
            self.x = self.x + Ph * ((leans - _MOST_FRICTION) / float(h @ Ph))

    def _lean(self, m: Measurement, s: HybridSetpoint) -> None:
        """A line of the tool that lies on the surface: across the axis about which the contact resists."""
        for axis, line in ((0, 1), (1, 0)):
            if s.torque_axes[axis] and s.contact_resists[axis]:
                direction = m.X_WT[:3, line]
                h = np.zeros(_SIZE)
                h[_A] = self.tangents @ direction
                self._correct(2, h, float(direction @ self.n), m.rotation_deviation**2)

    def _correct(self, kind: int, h: Array, seen: float, variance: float) -> None:
        """One scalar measurement, seen = h . x with that variance."""
        Ph = self.P @ h
        innovation, total = seen - float(h @ self.x), float(h @ Ph) + variance
        if self._edge(kind, innovation, total):
            self.P[1, 1] += _OPENED**2
            self.P[2, 2] += _OPENED**2
            self.P[3:6, 3:6] += np.eye(3) * _BEND**2
            if kind == 0:
                self.P[0, 0] += innovation * innovation
            Ph = self.P @ h
            total = float(h @ Ph) + variance
        gain = Ph / total
        self.x = self.x + gain * innovation
        self.P = self.P - np.outer(gain, Ph)

    def _edge(self, kind: int, innovation: float, variance: float) -> bool:
        if innovation * innovation < _GATE * variance:
            self._outside[kind] = 0
            return False
        side, before = (1 if innovation > 0 else -1), self._outside[kind]
        self._outside[kind] = before + side if before * side >= 0 else side
        return abs(int(self._outside[kind])) >= _IN_A_ROW

    def _turn(self, slope: Array) -> None:
        """Make the slope part of the normal; the tangents go along."""
        n = self._off(slope)
        if float(n @ self.expected) < _STEEPEST:
            self.x[_A] = 0.0
            return
        first = self.tangents[0] - float(self.tangents[0] @ n) * n
        first = first / np.sqrt(first @ first)
        self.n, self.tangents = n, np.array((first, np.cross(n, first)))
        self.x[_A] = 0.0
