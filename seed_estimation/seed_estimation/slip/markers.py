# SPDX-License-Identifier: Apache-2.0
"""The dots of one finger, followed without depth: where the membrane is, and whether it has sprung back.

A tool that breaks loose lets the membrane spring back by a part of its displacement within a frame or two. So does one
that is set free; but then the load is gone, and with it what a load does to a patch: it is one body again (`peel`; and
as much of its image is explained as usual). One that slides stays torn.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp, so3_log
from seed_estimation.images.sampling import Frame
from seed_estimation.rigid_fit.fit import Fit, fit, motion_vector
from seed_estimation.rigid_fit.normal_equations import solved
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import Sight
from seed_estimation.slip.incipient import creep_weights, peel

SIDEWAYS = np.array((1, 3, 5))  # turn about y, way along x and z: what friction bears
THREE = np.ix_(SIDEWAYS, SIDEWAYS)
HOLD = np.diag((1e9, 4.0, 1e9, 2.5e3, 1e12, 2.5e3))  # keeps roll, yaw and y, which the dots of one finger hardly show
FREE = np.diag((4.0, 2.5e3, 2.5e3))  # the same of the three alone
SPAN = 0.12  # [s] that is looked back
FALL_FRAMES = 2  # within which a membrane has sprung back
LOADED = 0.0015  # [m] below this displacement friction bears next to nothing
FALL, FALL_SHARE = 2e-4, 0.03  # [m], [1] by which dots must spring back, at least, and of their displacement
FALL_SURE, JITTER = 6.0, 3e-5  # deviations of noise, and what it is taken for at first [m]
PEELED, PEELED_SHARE = 0.02, 0.5  # [1] a patch that slides is peeled so much, and by so much of what it was before
ASIDE = 1.0  # [1] of the fall along their displacement, by which dots that spring back may leave it at most
LEAST, MOST = 0.7, 1.5  # [least falls] of which a frame is evidence, and as how much at most
SEEN = 1.2e-4  # [m] deviation of one frame up to which depth sees a direction: it pretends to see a cylinder's axis
MOSTLY = 0.95  # [1] of a direction that depth must see
BACK = (0.0, 0.1, 0.2, 0.3, 0.4, 0.7, 1.0)  # shares of the displacement by which dots are searched for; 1: set free
DOUBT, DOUBT_SURE = 0.03, 3.0  # [1], spreads; less explained than usual: the patch does not move as one
USUAL, QUIET = 0.1, 0.02  # [1] weights of a frame in what is usual, and in what is noise
FOUND, CLEAR = 0.5, 0.8  # [1] of the image that the dots must explain; from which on nothing is searched


class Depth(NamedTuple):
    """Where depth alone would put the tool: way (3,) as that of the dots [m], and its deviation [m]."""

    way: Array
    deviation: Array


UNSEEN = Depth(np.zeros(3), np.ones(3))


class Look(NamedTuple):
    """What one frame offers of one finger: where the tool may be (4, 4), and what was evaluated there, if anything."""

    frame: Frame
    near: Array
    sight: Sight | None
    slip: float
    stamp: float
    depth: Depth


class Seen(NamedTuple):
    """One frame: the dots' way (3,) since the grasp [m] (turn about y at the patch's reach, x, z), and depth's."""

    stamp: float
    way: Array
    size: float  # [m] of the displacement
    depth: Depth
    peel: float  # [1]
    doubtful: bool  # less of the image is explained than usual


class Dots:
    """One finger's, in one grasp."""

    def __init__(self, model: FingerModel, lever: Array, centre: Array) -> None:
        """lever (3,): from turn about y [rad] and way along x and z [m] to displacement [m]; centre: of `sideways`."""
        self._model, self._lever, self._centre = _without_depth(model), lever, centre
        self._creep = creep_weights(model)
        self.seen: deque[Seen] = deque()
        self.X_CT = np.eye(4)
        self._usual = 0.0  # [1] how much of the image is explained while the tool sticks
        self._spread = 0.0  # [1] how far it strays from that
        self._jitter = JITTER  # [m] deviation of the displacement's second difference over frames

    def forget(self, stamp: float) -> None:
        """What lies too far back."""
        while self.seen and stamp - self.seen[0].stamp > SPAN:
            self.seen.popleft()

    def fallen(self, look: Look) -> float | None:
        """By how many least falls the dots fell at once, without the tool, the patch still torn; None: not found."""
        near, sight = look.near, look.sight
        explained = sight.locked() if sight is not None else 0.0
        if sight is None or self._doubts(explained):
            found = self._search(look)
            if found is None:
                return None
            near, sight, explained = found.X_CT, found.sights[0], _explained(found)
        self.X_CT, motion = near, motion_vector(near)
        way = self._lever * (sideways(near, self._centre) - _step(sight))
        torn = peel(sight, motion, self._creep, HOLD)
        self.seen.append(Seen(look.stamp, way, math.hypot(*way), look.depth, torn, self._doubts(explained)))
        self._learn(explained)
        self._learn_jitter()
        return self._fall()

    def _doubts(self, explained: float) -> bool:
        return explained < self._usual - DOUBT - DOUBT_SURE * self._spread

    def _search(self, look: Look) -> Fit | None:
        """The dots near where the tool may be, where they were last or further back; None: not found."""

        def fitted(start: Array, steps: tuple[int, int]) -> Fit:
            return fit([self._model], {self._model.finger: look.frame}, start, look.slip, HOLD, steps)

        found = fitted(look.near, (0, 4))
        if _explained(found) > CLEAR:
            return found
        starts = [look.near, *(_eased(self.X_CT, share) for share in BACK)]
        best = max((fitted(start, (3, 1)) for start in starts), key=_explained)
        found = fitted(best.X_CT, (3, 8))
        return found if _explained(found) > FOUND else None

    def _learn(self, explained: float) -> None:
        """What is usual; what slides is not."""
        if len(self.seen) < 2 and self._usual == 0.0:
            self._usual = explained
        less = min(self._usual - explained, 2.0 * DOUBT)
        self._usual -= USUAL * less
        self._spread += USUAL * (abs(less) - self._spread)

    def _fall(self) -> float:
        falls = {back: self._lost_way(back) for back in range(1, min(FALL_FRAMES, len(self.seen) - 3) + 1)}
        back = max(falls, key=lambda b: falls[b], default=0)
        share = falls[back] / self._least_fall(self.seen[-1 - back].size) if back else 0.0
        if share < LEAST or not (self._straight_back(back) and self._torn(back)):
            return 0.0
        return 0.0 if self._depth_fell_too(back, falls[back]) else min(share, MOST)

    def _lost_way(self, back: int) -> float:
        """By how much less [m] the dots are displaced than so many frames ago, and than their speed then foretold."""
        top, now = self.seen[-1 - back], self.seen[-1]
        if top.size < LOADED:
            return 0.0
        return min(top.size, math.hypot(*self._foretold(back))) - now.size

    def _foretold(self, back: int) -> Array:
        """The dots' way (3,) [m] now, had they kept the speed of so many frames ago."""
        before, top, now = self.seen[-3 - back], self.seen[-1 - back], self.seen[-1]
        speed = (top.way - before.way) / (top.stamp - before.stamp)
        return np.asarray(top.way + speed * (now.stamp - top.stamp))

    def _straight_back(self, back: int) -> bool:
        """Whether the dots fell along their displacement: a sheet that loses its load springs back against it.

        A sudden pull elsewhere makes a displacement smaller, too.
        """
        foretold, now = self._foretold(back), self.seen[-1]
        size = math.hypot(*foretold)
        along = float(now.way @ foretold) / size
        aside = math.sqrt(max(now.size**2 - along**2, 0.0))
        return aside <= ASIDE * (size - along)

    def _torn(self, back: int) -> bool:
        """Whether the patch is still what a load had made of it so many frames ago."""
        before, now = self.seen[-1 - back], self.seen[-1]
        return now.doubtful or now.peel > max(PEELED, PEELED_SHARE * before.peel)

    def _least_fall(self, size: float) -> float:
        """What noise does not do to a displacement [m]."""
        return max(FALL, FALL_SHARE * size, FALL_SURE * self._jitter)

    def _learn_jitter(self) -> None:
        if len(self.seen) > 2:
            a, b, c = (self.seen[i].size for i in (-3, -2, -1))
            change = min(abs(c - 2.0 * b + a), 2.0 * self._jitter)  # a sudden pull is no noise
            self._jitter = math.sqrt(self._jitter**2 + QUIET * (change**2 - self._jitter**2))

    def _depth_fell_too(self, back: int, fall: float) -> bool:
        """Whether depth sees the direction of the fall, by and large, and that the tool fell with the dots."""
        a, b = self.seen[-1 - back], self.seen[-1]
        direction = (b.way - a.way) / max(math.hypot(*(b.way - a.way)), 1e-9)
        direction[np.maximum(a.depth.deviation, b.depth.deviation) >= SEEN] = 0.0
        stayed = -float(direction @ ((b.depth.way - b.way) - (a.depth.way - a.way)))
        return math.hypot(*direction) > MOSTLY and stayed < 0.3 * fall


def sideways(X_CT: Array, centre: Array) -> Array:
    """Turn about y [rad] and way along x and z [m] (3,) of the tool's point `centre` (3,), on the y axis."""
    way = X_CT[:3, :3] @ centre + X_CT[:3, 3] - centre
    return np.array((so3_log(X_CT[:3, :3])[1], way[0], way[2]))


def _step(sight: Sight) -> Array:
    """What the image alone asks to change of the three (3,), the other axes held: H^-1 g."""
    return solved(sight.image.H[THREE] + FREE, sight.image.g[SIDEWAYS])


def _explained(found: Fit) -> float:
    return next(iter(found.locked.values()))


def _without_depth(model: FingerModel) -> FingerModel:
    none = np.zeros((3, 0), np.float32)
    return replace(model, p=none, n=none, n_p=none[0], J=np.zeros((6, 0), np.float32), cells=model.cells[:0])


def _eased(X_CT: Array, share: float) -> Array:
    """X_CT with so much of its sideways motion since the grasp taken back."""
    motion = motion_vector(X_CT)
    motion[SIDEWAYS] *= 1.0 - share
    return make_pose(so3_exp(motion[:3]), motion[3:])
