# SPDX-License-Identifier: Apache-2.0
"""The tool breaks loose: what a camera behind the membrane sees of it, and an alarm made of that.

Dots show where the membrane is, depth shows where the tool is. While the tool sticks, both move as one. When it breaks
loose, sliding friction bears less than what it stuck with, so the membrane springs back by a part of its sideways
displacement within a frame or two and then stays where it is, while the tool goes on. Hence two signs:

    sprung back   the displacement of the dots since the grasp, which had been growing or resting, falls at once by a
                  part and rests again, and the patch, which lets go from its edge, is not explained as well
                  as usual; and where depth sees that direction well, depth does not fall with it
    apart         depth goes on where dots do not, by more than micro-slip and noise explain

A tool that is set free springs back as well, but all the way, and depth follows. Along an axis that depth does not see
(a long cylinder's own) only the first sign is there: a tool that springs back by a part and rests looks the same.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp
from seed_estimation.finger_model import FingerModel
from seed_estimation.frame import Frame
from seed_estimation.rigid_fit import Fit, fit, motion_vector

SIDEWAYS = np.array((1, 3, 5))  # turn about y, way along x and z: what friction bears
SPAN = 0.12  # [s] that is looked back
LOADED = 0.0015  # [m] below this displacement friction bears next to nothing
FALL, FALL_SHARE = 1.2e-4, 0.03  # [m], [1] by which dots must spring back, at least, and of their displacement
FALL_SURE, JITTER = 6.0, 3e-5  # deviations of noise, and what it is taken for at first [m]
PART = 0.4  # [1] less than this share left: the tool was set free
HALT = 0.5  # [1] of the longest step per frame: less is rest
SEEN = 1.2e-4  # [m] deviation of one frame up to which depth sees a direction: it pretends to see a cylinder's axis
APART, APART_SURE, APART_SHARE = 2.5e-4, 5.0, 0.3  # [m], deviations, share of the way: all three together
HOLD = np.diag((1e4, 4.0, 1e4, 2.5e3, 1e7, 2.5e3))  # keeps roll, yaw and y of the dots, which they hardly show
BACK = (0.0, 0.1, 0.2, 0.3, 0.4, 0.7, 1.0)  # shares of the displacement by which dots are searched for; 1: set free
DOUBT, DOUBT_SURE = 0.03, 3.0  # [1], spreads; less explained than usual: the dots are looked at alone
USUAL, QUIET = 0.1, 0.02  # [1] weights of a frame in what is usual, and in what is noise
BROKEN = 0.05  # [s] after which dots that cannot be found as one body are taken for a slip
FOUND = 0.5  # [1] of the images that the dots alone must explain


class _Seen(NamedTuple):
    stamp: float
    way: Array  # (3,) of the dots since the grasp [m]: turn about y at the patch's reach, x, z
    apart: Array  # (3,) depth minus dots [m]
    deviation: Array  # (3,) of apart [m]
    doubtful: bool = False  # less of an image was explained than usual: the patch does not move as one


class GrossSlip:
    """Watches one grasp: `update` with every frame, locked or not."""

    def __init__(self, models: Sequence[FingerModel]) -> None:
        p = np.concatenate([m.p for m in models], axis=1)
        reach = float(np.sqrt(np.square(p[[0, 2]] - p[[0, 2]].mean(axis=1, keepdims=True)).sum(axis=0).mean()))
        self._lever = np.array((reach, 1.0, 1.0))
        self._alone = len(models) < 2
        self._dots = [_without_depth(m) for m in models]
        self._seen: deque[_Seen] = deque()
        self._usual = 0.0  # [1] how much of the worse image is explained while the tool sticks
        self._spread = 0.0  # [1] how far it strays from that
        self._X_dots = np.eye(4)
        self._jitter = JITTER  # [m] deviation of the displacement's second difference over frames

    def update(self, frames: Mapping[str, Frame], result: Fit, stamp: float, slip: float) -> bool:
        """Whether a locked frame shows that the tool slides."""
        worse = min(result.locked.values())
        doubtful = self._doubtful(worse)
        alone = self.dots(frames, slip) if doubtful and not self._alone else None
        if self._alone or (alone is None and worse < FOUND):  # one bubble by itself mistakes yaw for x
            self._forget(stamp)
            return False
        signs = self._signs(result, stamp)._replace(doubtful=doubtful)
        self._X_dots = alone.X_CT if alone else result.X_CT
        self._seen.append(signs._replace(way=self._way(alone.X_CT)) if alone else signs)
        self._forget(stamp)
        slides = self._sprung_back() or self._apart()
        self._learn_jitter()
        return slides

    def _doubtful(self, explained: float) -> bool:
        """Whether so much less of the worse image is explained than usual that the dots should be looked at alone."""
        if not self._seen:
            self._usual = explained
        less = self._usual - explained
        doubtful = less > DOUBT + DOUBT_SURE * self._spread
        less = min(less, 2.0 * DOUBT)  # what slides is not what is usual
        self._usual -= USUAL * less
        self._spread += USUAL * (abs(less) - self._spread)
        return doubtful

    def lost(self, X_dots: Array | None, stamp: float) -> bool:
        """Whether a lock that broke shows it: dots were found to have sprung back, or form one body no more."""
        self._forget(stamp)
        before = max((float(np.linalg.norm(s.way)) for s in self._seen), default=0.0)
        if before < LOADED:
            return False
        if X_dots is not None and before - float(np.linalg.norm(self._way(X_dots))) > self._least_fall(before):
            return True
        return stamp - self._seen[-1].stamp > BROKEN

    def dots(self, frames: Mapping[str, Frame], slip: float) -> Fit | None:
        """The dots alone, without depth, where they were last or further back; None: not found."""
        starts = [_eased(self._X_dots, share) for share in BACK]
        looked = [fit(self._dots, frames, start, slip, HOLD, (3, 1)) for start in starts]
        best = max(looked, key=_explained)
        found = fit(self._dots, frames, best.X_CT, slip, HOLD, (3, 8))
        return found if _explained(found) > FOUND else None

    def _forget(self, stamp: float) -> None:
        while self._seen and stamp - self._seen[0].stamp > SPAN:
            self._seen.popleft()

    def _way(self, X: Array) -> Array:
        return np.asarray(self._lever * motion_vector(X)[SIDEWAYS])

    def _signs(self, result: Fit, stamp: float) -> _Seen:
        """Where image and depth would each like to go, the other axes held: H^-1 g of the three."""
        three = np.ix_(SIDEWAYS, SIDEWAYS)
        floor = np.diag((4.0, 2.5e3, 2.5e3))
        H_image, H_depth = result.H_image[three] + floor, result.H_depth[three] + floor
        dots = np.linalg.solve(H_image, result.g_image[SIDEWAYS])
        depth = np.linalg.solve(H_depth, result.g_depth[SIDEWAYS])
        deviation = self._lever * np.sqrt(np.diag(np.linalg.inv(H_depth) + np.linalg.inv(H_image)))
        way = self._way(result.X_CT) - self._lever * dots
        return _Seen(stamp, way, self._lever * (dots - depth), deviation)

    def _sprung_back(self) -> bool:
        """The displacement's size over the last frames: rising or at rest, one sudden fall, rest."""
        if len(self._seen) < 4 or not any(s.doubtful for s in self._seen):
            return False  # a tool that swings falls and rests as well, but its patch stays one
        way = np.array([s.way for s in self._seen])
        size = np.linalg.norm(way, axis=1)
        top = int(np.argmax(size))
        fall = float(size[top] - size[-1])
        if top == 0 or top > len(size) - 3 or size[top] < LOADED or size[-1] < PART * size[top]:
            return False
        steps = np.linalg.norm(np.diff(way[top:], axis=0), axis=1)
        if fall < self._least_fall(float(size[top])) or steps[-1] > HALT * steps.max():
            return False
        return not self._depth_fell_too(top, fall)

    def _least_fall(self, size: float) -> float:
        """What noise does not do to a displacement [m]."""
        return max(FALL, FALL_SHARE * size, FALL_SURE * self._jitter)

    def _learn_jitter(self) -> None:
        if len(self._seen) > 2:
            a, b, c = (float(np.linalg.norm(self._seen[i].way)) for i in (-3, -2, -1))
            change = min(abs(c - 2.0 * b + a), 2.0 * self._jitter)  # a sudden pull is no noise
            self._jitter = math.sqrt(self._jitter**2 + QUIET * (change**2 - self._jitter**2))

    def _depth_fell_too(self, top: int, fall: float) -> bool:
        """Whether depth sees the direction of the fall, and that the tool fell with the dots."""
        a, b = self._seen[top], self._seen[-1]
        way = b.way - a.way
        direction = way / max(float(np.linalg.norm(way)), 1e-9)
        deviation = float(np.linalg.norm(direction * b.deviation))
        stayed = -float(direction @ (b.apart - a.apart))
        return deviation < SEEN and stayed < 0.3 * fall

    def _apart(self) -> bool:
        """Whether depth has gone on without the dots, along an axis that it sees."""
        seen = list(self._seen)
        if len(seen) < 5:
            return False
        before, now = seen[: len(seen) // 2], seen[-2:]
        change = np.abs(np.mean([s.apart for s in now], axis=0) - np.mean([s.apart for s in before], axis=0))
        if change.max() <= APART:
            return False
        way = np.abs(np.diff([s.way for s in seen], axis=0)).sum(axis=0)
        deviation = np.median([s.deviation for s in before], axis=0)  # residuals grow when tool and dots part
        large = change > APART + APART_SURE * deviation + APART_SHARE * way
        return bool((large & (deviation < SEEN)).any())


def _explained(found: Fit) -> float:
    return float(np.mean(list(found.locked.values())))


def _without_depth(model: FingerModel) -> FingerModel:
    none = np.zeros((3, 0), np.float32)
    return replace(model, p=none, n=none, n_p=none[0], J=np.zeros((6, 0), np.float32), cells=model.cells[:0])


def _eased(X_CT: Array, share: float) -> Array:
    """X_CT with so much of its sideways motion since the grasp taken back."""
    motion = motion_vector(X_CT)
    motion[SIDEWAYS] *= 1.0 - share
    return make_pose(so3_exp(motion[:3]), motion[3:])
