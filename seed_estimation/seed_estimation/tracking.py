# SPDX-License-Identifier: Apache-2.0
"""Following the tool from frame to frame: prediction, locked or lost, finding it again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from seed_core.spatial import inverse_pose, so3_exp, so3_log
from seed_estimation.camera import Array
from seed_estimation.covariance import Covariance
from seed_estimation.finger_model import FingerModel
from seed_estimation.frame import Box, Frame, project32
from seed_estimation.gross_slip import SPAN, GrossSlip
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.rigid_fit import Fit, fit
from seed_estimation.slip import MicroSlip

# Information that holds an axis which nothing sees where the prediction puts it: deviations of 0.5 rad and 20 mm
PRIOR = np.diag([1 / 0.5**2] * 3 + [1 / 0.02**2] * 3)
COARSE_STEPS = 6
SURE = 0.05  # a track that was lost must explain this much more of the image to count as found
SURE_FRAMES = 2  # and do so this many frames in a row
STARTS = 3  # places tried per frame while lost: one camera period is not enough for all of them
REACH = 0.35, 0.012  # [rad], [m] no tool jumps further than this between two frames


class Tracker:
    """Pose of the tool since the grasp, by `rigid_fit`, with a constant-velocity prediction."""

    def __init__(self, models: Sequence[FingerModel], parameters: EstimatorParameters, stamp: float) -> None:
        self.models, self.parameters = tuple(models), parameters
        self.X_CT = np.eye(4)
        self.rate = np.zeros(6)  # [rotation vector, translation] per second, in C
        self.stamp = stamp
        self.lost = False
        self.gross_slip = False
        self.slip = MicroSlip(parameters.max_slip)
        self.covariance = Covariance(PRIOR)
        self._watch = GrossSlip(models)
        self._good = 0  # frames in a row since it was found again
        self._starts: Iterator[Array] = iter(())

    def lose(self) -> None:
        """Too much time has passed: the track must be found again."""
        self.lost, self._good, self._starts = True, 0, iter(())

    def predicted(self, stamp: float) -> Array:
        """X_CT (4, 4) expected at a time [s]."""
        dt = min(max(stamp - self.stamp, 0.0), 0.1)
        if self.lost:
            return self.X_CT
        X = self.X_CT.copy()
        X[:3, :3] = so3_exp(self.rate[:3] * dt) @ X[:3, :3]
        X[:3, 3] += self.rate[3:] * dt
        return X

    def boxes(self, X_CT: Array) -> dict[str, Box]:
        """Where each finger's points are expected: first, last u, first, last v [px]."""
        out = {}
        for m in self.models:
            X = m.X_XC @ X_CT
            pixels = project32(m.camera, (X[:3, :3] @ m.p[:, ::7] + X[:3, 3:]).astype(np.float32))
            (u0, v0), (u1, v1) = np.clip(np.nan_to_num((pixels.min(axis=1), pixels.max(axis=1))), -1e5, 1e5).astype(int)
            out[m.finger] = (int(u0), int(u1), int(v0), int(v1))
        return out

    def step(self, frames: Mapping[str, Frame], stamp: float) -> Fit:
        """The best fit to the frames; `lost` says whether it may be believed."""
        p = self.parameters
        start = self.predicted(stamp)
        steps = (COARSE_STEPS, p.iterations) if self.lost else (0, p.iterations)
        best = self._fit(frames, start, steps)
        quality = self._quality(best)
        if quality < p.lock:
            others = self._next_starts() if self.lost else [start, self.X_CT]
            looked = [self._fit(frames, other, (COARSE_STEPS, 1)) for other in others]
            nearest = max(looked, key=self._quality)
            best = max(best, self._fit(frames, nearest.X_CT, (0, p.iterations)), key=self._quality)
            if self._quality(best) < p.lock and 0.0 < stamp - self.stamp <= SPAN:
                best = self._by_dots(frames, best, stamp)
            quality = self._quality(best)
        self._accept(best, quality, frames, stamp)
        return best

    def _by_dots(self, frames: Mapping[str, Frame], best: Fit, stamp: float) -> Fit:
        """A lock that broke just now: the dots may have sprung back with the tool, or without it, which is a slip."""
        dots = self._watch.dots(frames, self.slip.value)
        if dots is not None:
            both = self._fit(frames, dots.X_CT, (0, self.parameters.iterations))
            if self._quality(both) >= self.parameters.lock:
                return both
        self.gross_slip |= self._watch.lost(dots.X_CT if dots else None, stamp)
        return best

    def _fit(self, frames: Mapping[str, Frame], start: Array, steps: tuple[int, int]) -> Fit:
        return fit(self.models, frames, start, self.slip.value, PRIOR, steps)

    def _quality(self, result: Fit) -> float:
        """Share of the images explained by the motion; a motion that no tool makes explains nothing."""
        step = inverse_pose(self.X_CT) @ result.X_CT
        if not np.isfinite(step).all():
            return 0.0
        angle, way = float(np.linalg.norm(so3_log(step[:3, :3]))), float(np.linalg.norm(step[:3, 3]))
        if angle > REACH[0] or way > REACH[1]:
            return 0.0
        return max(result.locked.values())

    def _accept(self, result: Fit, quality: float, frames: Mapping[str, Frame], stamp: float) -> None:
        p, dt = self.parameters, stamp - self.stamp
        if self.lost:
            self._good = self._good + 1 if quality > p.lock + SURE else 0
            if self._good < SURE_FRAMES:
                if self._good:
                    self.X_CT, self.stamp = result.X_CT, stamp
                return
        elif quality < p.lock:
            self.lose()
            return
        follow = not self.lost and 0.0 < dt <= 0.2
        self.rate = self._rate(result.X_CT, dt) if follow else np.zeros(6)
        self.X_CT, self.stamp, self.lost = result.X_CT, stamp, False
        self.covariance.update(result)
        self.gross_slip |= self._watch.update(frames, result, stamp, self.slip.value)
        if p.learn_slip and follow:
            self.slip.update(result.slip_step, result.slip_information, dt)

    def _rate(self, X_CT: Array, dt: float) -> Array:
        turn = so3_log(X_CT[:3, :3] @ self.X_CT[:3, :3].T)
        return np.concatenate([turn, X_CT[:3, 3] - self.X_CT[:3, 3]]) / dt

    def _next_starts(self) -> list[Array]:
        """The next few places to look at, around where the tool was last seen."""
        out = []
        for _ in range(STARTS):
            start = next(self._starts, None)
            if start is None:
                self._starts = iter(around(self.X_CT))
                start = next(self._starts)
            out.append(start)
        return out


def around(X_CT: Array) -> list[Array]:
    """Poses near X_CT (4, 4), nearest first, about as far apart as the coarse level reaches: 3 px, 5 degrees."""
    out = []
    for dx in (0.0, -0.0015, 0.0015, -0.003, 0.003):
        for dz in (0.0, -0.0015, 0.0015, -0.003, 0.003):
            for pitch in (0.0, -0.08, 0.08, -0.16, 0.16):
                X = X_CT.copy()
                X[:3, :3] = so3_exp((0.0, pitch, 0.0)) @ X[:3, :3]
                X[:3, 3] += (dx, 0.0, dz)
                out.append((abs(dx) / 0.0015 + abs(dz) / 0.0015 + abs(pitch) / 0.08, X))
    return [X for _, X in sorted(out, key=lambda item: item[0])]
