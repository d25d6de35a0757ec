# SPDX-License-Identifier: Apache-2.0
"""Material that was dragged along an axis that depth does not see, and stops: has the tool stopped, or does it slide?

Friction holds a patch back from its ends inwards. Where it slides, the sheet is stretched behind and compressed ahead,
so the ends lag behind the middle; where it sticks, all of it goes as far as the tool. So the lag of the ends grows with
the way of the material, and the faster the more of the patch slides: by 0.03 of the way while a quarter of it does, by
0.05 at two thirds, by 0.07 from there on. A tool that is stopped by a table leaves next to no lag. A sheet so soft that
it gives way all over long before it slides leaves more; but its edge has crept by less (`incipient.py`).
"""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array
from seed_estimation.images.sampling import Crop
from seed_estimation.images.tactile_images import Bools
from seed_estimation.material.motion import Followed, MaterialTracker
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.slip.markers import Markers

FAST, LATELY = 0.015, 0.14  # [m/s] of both fingers' dragged markers, within so many [s]
STOPPED, BACK = 0.25, -0.15  # [1] of its largest speed, between which a finger's markers rest
RESTS = 2  # frames in a row: a tool that turns back rests for one
LAG, GROWTH = 1e-4, 0.055  # [m] of the patch's ends behind its middle, mean of both; [1] of the way, by which it grew
EDGE = 0.025  # [1] least incipient slip of a patch that slides
EVENLY = 3.5  # [1] growth over incipient slip, from which on the sheet gives way all over
WAY = 8e-4  # [m] least way over which that is measured
ENDS = np.array((3, 8))  # of `MaterialMotion.deformation`: u^2 along x, v^2 along z
AXES = slice(1, 3)  # of a displacement: along x and z


class Drag(NamedTuple):
    """Both fingers' material in one frame; rows: fingers, columns: along x and z.

    Attributes:
        stamp: [s].
        way: (2, 2) of the markers since the grasp [m].
        lag: (2, 2) of the patch's ends, along the axis [m]; None: not looked at, or not found.
        incipient: incipient slip, mean of both fingers [1].
    """

    stamp: float
    way: Array
    lag: Array | None
    incipient: float


class Stretching:
    """The patches of both fingers in one grasp."""

    def __init__(self, models: Sequence[FingerModel]) -> None:
        self._fingers = tuple(m.finger for m in models)
        self._patches = Followed([MaterialTracker(m, m.patch) for m in models])
        self._drags: deque[Drag] = deque()
        self._last: tuple[Mapping[str, Crop], Array] | None = None  # images and pose of the last frame

    def slides(self, crops: Mapping[str, Crop], X_CT: Array, markers: Sequence[Markers], unseen: Bools) -> bool:
        """Whether markers that both fingers show in these images stop as on a tool that slides.

        X_CT (4, 4): of the tool; unseen (2,): whether depth does not see its way along x and along z.
        """
        now = [m.seen[-1] for m in markers]
        stamp, way = now[0].stamp, np.array([s.displacement[AXES] for s in now])
        while self._drags and not 0.0 < stamp - self._drags[0].stamp <= LATELY:
            self._drags.popleft()
        self._drags.append(Drag(stamp, way, None, float(np.mean([s.incipient for s in now]))))
        last, self._last = self._last, (crops, X_CT)
        if not (self._fast() & unseen).any():
            return False
        if len(self._drags) > 1 and self._drags[-2].lag is None and last is not None:
            self._drags[-2] = self._drags[-2]._replace(lag=self._lag(*last))
        self._drags[-1] = self._drags[-1]._replace(lag=self._lag(crops, X_CT))
        return any(stops_stretched(self._drags, axis) for axis in (0, 1) if unseen[axis])

    def _fast(self) -> Bools:
        """Whether both fingers' material was dragged lately, along x and along z (2,)."""
        speed = _speeds([d.stamp for d in self._drags], [d.way for d in self._drags])
        return np.asarray(np.abs(speed).min(axis=1).max(axis=0, initial=0.0) > FAST)

    def _lag(self, crops: Mapping[str, Crop], X_CT: Array) -> Array | None:
        found = self._patches.follow(crops, X_CT)
        if any(f not in found or found[f].explained == 0.0 for f in self._fingers):
            return None
        return np.array([found[f].deformation[ENDS] for f in self._fingers])


def stops_stretched(drags: Sequence[Drag], axis: int) -> bool:
    """Whether the material of both fingers, dragged until lately along x (axis 0) or z (1), stops, and so much of the
    patches has slid on the tool that the tool slides."""
    now = drags[-1]
    speed = _speeds([d.stamp for d in drags], [d.way[:, axis] for d in drags])  # (frames - 1, fingers)
    if len(speed) <= RESTS or now.lag is None:
        return False
    along = np.sign(speed[np.abs(speed.mean(axis=1)).argmax()].mean())
    speed = along * speed
    largest = speed.max(axis=0)
    rests = (speed[-RESTS:] < STOPPED * largest) & (speed[-RESTS:] > BACK * largest)
    lag = -along * float(now.lag[:, axis].mean())
    if largest.min() < FAST or not rests.all() or lag < LAG or now.incipient < EDGE:
        return False
    for before in reversed(list(drags)[:-1]):
        way = along * float((now.way - before.way)[:, axis].mean())
        if way > WAY and before.lag is not None:
            growth = (lag + along * float(before.lag[:, axis].mean())) / way
            return bool(GROWTH < growth < EVENLY * now.incipient)
    return False


def _speeds(stamps: Sequence[float], ways: Sequence[Array]) -> Array:
    """[m/s] from frame to frame."""
    dt = np.diff(stamps)
    steps = np.diff(np.array(ways), axis=0)
    return np.asarray(steps / dt.reshape(-1, *[1] * (steps.ndim - 1)))
