# SPDX-License-Identifier: Apache-2.0
"""The last second of a contact: how far the grasp was deflected, and where kinematics had the gripper.

In contact the tip stays on the surface, so along a force direction n the deflection d = n . (p_WC - p_WT) follows the
gripper's height c, which is counted with the tool's lever:

    d(t) = a + (1 - beta) c(t) - g . s(t)         s: the place across n, g: the surface's slope, beta as in the observer

d comes from the image alone and c from kinematics alone. A wrong stamp makes one of them late; a grasp that slides or
stiffens may look like it (mechanical_lag.py).
"""

from collections import deque
from math import sqrt
from typing import NamedTuple

import numpy as np

from seed_control.monitor.contact.mechanical_lag import certainty
from seed_control.wrench.estimate import Measurement
from seed_control.wrench.history import PoseHistory
from seed_core.spatial import Array, cross

WINDOW = 1.2  # [s] that is looked at
REACH = 0.15  # [s] of stamp errors that are looked for
_STEP = 0.0125  # [s] between those that are tried
SHIFTS = np.arange(-REACH, REACH + 0.5 * _STEP, _STEP)  # [s] by which stamps might be ahead
_SLOPE, _SHARE = 0.05, 0.4  # deviations of the surface's slope, and of 1 - beta from one
SHARES = 0.1, 1.4  # of the gripper's motion that a deflection may follow
_FEW = 8  # images that tell nothing yet
_LEAST_MOTION = 1e-3  # [m] of the deflection
_LEAST_DEVIATION = 5e-5  # [m] of a deflection, whatever is stated
_INFLATION = 2.0  # of the variance: errors of neighbouring images are alike


class FollowedMotion(NamedTuple):
    """How the deflection along a force direction follows the gripper.

    Attributes:
        shift: by which stamps are ahead [s], as the motion has it; deviation: its standard deviation [s].
        share: 1 - beta of the gripper's motion that the deflection follows.
        explained: part of the deflection's variance that it explains.
        steepness: standard deviation of the deflection per way across [1]: no surface is that steep all along.
    """

    shift: float
    deviation: float
    share: float
    explained: float
    steepness: float


class _Aligned(NamedTuple):
    """d: (N,) deflection; X: (3, shifts, N) height and places across at each shift; variance of d; way across."""

    d: Array
    X: Array
    variance: float
    shifts: Array
    way: float


class ContactMotion:
    """Images since contact was made, `WINDOW` seconds of them at most."""

    def __init__(self, p_EC: Array) -> None:
        """p_EC: (3,) [m] gripper's frame C in the flange."""
        self._p_EC = p_EC
        self._rows: deque[tuple[float, Array, Array, float]] = deque(maxlen=600)

    def __len__(self) -> int:
        return len(self._rows)

    def clear(self) -> None:
        """Contact is over."""
        self._rows.clear()

    def add(self, m: Measurement) -> None:
        """Take in an image in contact."""
        p_WT = m.X_WT[:3, 3]
        if self._rows and m.stamp < self._rows[-1][0]:  # the clock was set back
            self._rows.clear()
        self._rows.append((m.stamp, m.X_WC[:3, 3] - p_WT, m.tip - p_WT, m.variance))
        while self._rows[0][0] < m.stamp - WINDOW:
            self._rows.popleft()

    def followed(self, n: Array, history: PoseHistory, shift: float | None = None) -> FollowedMotion | None:
        """Along the unit vector n (3,); None while too little has moved to tell.

        shift: [s] by which stamps are known to be ahead; None: to be found.
        """
        aligned = self._aligned(n, history, shift)
        return None if aligned is None else _best(*aligned)

    def sure(self, n: Array, history: PoseHistory) -> float:
        """Chi-square by which a lag explains the deflection better than whatever a grasp could do without one."""
        aligned = self._aligned(n, history, None)
        prior = np.square((_SHARE, _SLOPE, _SLOPE))
        return 0.0 if aligned is None else certainty(aligned.d, aligned.X, aligned.variance, prior, _INFLATION)

    def _aligned(self, n: Array, history: PoseHistory, shift: float | None) -> _Aligned | None:
        d = np.array([row[1] for row in self._rows]) @ n if len(self) >= _FEW else np.zeros(1)
        if float(np.ptp(d)) < _LEAST_MOTION:
            return None
        times = np.array([row[0] for row in self._rows])
        path = self._path(times[0], history)
        if path is None:
            return None
        stamps, places = path
        inside = (times - REACH >= stamps[0]) & (times + REACH <= stamps[-1]) if shift is None else times > 0.0
        if np.count_nonzero(inside) < _FEW:
            return None
        lever = np.array([row[2] for row in self._rows])[inside] @ n
        variance = max(sum(row[3] for row in self._rows) / len(self), _LEAST_DEVIATION**2)
        shifts = SHIFTS if shift is None else np.array([shift])
        when, across = times[inside] - shifts[:, None], _across(n)
        c, s1, s2 = (np.interp(when, stamps, places @ axis) for axis in (n, *across))
        way = float(np.abs(np.diff(np.stack((s1[0], s2[0])))).sum())
        return _Aligned(d[inside], np.stack((c + lever, s1, s2)), variance, shifts, way)

    def _path(self, since: float, history: PoseHistory) -> tuple[Array, Array] | None:
        """Stamps (N,) [s] and places of C (N, 3) [m], of every second flange pose; None: no pose is as new as that."""
        entries = history.since(since - 2.0 * REACH)[::2]
        if not entries:
            return None
        X = np.array([X[:3] for _, X in entries])
        return np.array([t for t, _ in entries]), X[:, :, :3] @ self._p_EC + X[:, :, 3]


def _across(n: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) across n and each other."""
    a = np.eye(3)[int(np.argmin(np.abs(n)))]
    a = a - n * float(n @ a)
    a = a / np.sqrt(a @ a)
    return a, cross(n, a)


def _best(d: Array, X: Array, variance: float, shifts: Array, way: float) -> FollowedMotion | None:
    """The shift at which d (N,) is best explained by X (3, shifts, N): height, and place across.

    Least squares with a prior on share and slope, for all shifts at once.
    """
    count = len(d)
    d, X = d - d.mean(), X - X.mean(axis=2, keepdims=True)
    prior = variance / np.square((_SHARE, _SLOPE, _SLOPE))
    H = np.einsum("ijn,kjn->jik", X, X) + np.diag(prior)
    g = (X @ d).T + prior * (1.0, 0.0, 0.0)
    x = np.linalg.solve(H, g[..., None])[..., 0]
    total = float(d @ d)
    cost = total + prior[0] - np.einsum("ji,ji->j", x, g)
    i, shift, deviation = int(np.argmin(cost)), float(shifts[0]), 0.0
    if len(shifts) > 1:
        i = min(max(i, 1), len(shifts) - 2)
        left, here, right = cost[i - 1 : i + 2].tolist()
        curvature = left - 2.0 * here + right
        if curvature <= 0.0:
            return None
        noise = _INFLATION * max(here / max(count - 4, 1), variance)
        shift = float(shifts[i]) + _STEP * min(max(0.5 * (left - right) / curvature, -1.0), 1.0)
        deviation = _STEP * sqrt(2.0 * noise / curvature)
    explained = max(total - float(cost[i]), 0.0)
    steepness = sqrt(explained / count) / max(way, 1e-6)
    return FollowedMotion(shift, deviation, float(x[i, 0]), explained / total, steepness)
