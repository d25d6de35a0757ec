# SPDX-License-Identifier: Apache-2.0
"""Following the tool from frame to frame: prediction, locked or lost, finding it again."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from seed_core.spatial import Array, inverse_pose, so3_exp, so3_log
from seed_estimation.images.sampling import Box, Frame, project32
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.rigid_fit.covariance import HIDDEN, Covariance
from seed_estimation.rigid_fit.fit import Fit, fit
from seed_estimation.rigid_fit.micro_slip import MicroSlip
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.relocalise import Search
from seed_estimation.slip.gross import GrossSlip
from seed_estimation.slip.markers import SPAN

# Information that holds an axis which nothing sees where the prediction puts it: deviations of 0.5 rad and 20 mm
PRIOR = np.diag([1 / 0.5**2] * 3 + [1 / 0.02**2] * 3)
COARSE_STEPS = 6
SURE = 0.05  # a track that was lost must explain this much more of every image to count as found
SURE_FRAMES = 2  # and do so this many frames in a row
REACH = 0.35, 0.012  # [rad], [m] no tool jumps further than this between two frames
RANGE = 0.9, 0.03  # [rad], [m] nor is it found further than this from where it was grasped
APART = 3.0  # times the usual depth residual: the tool is not there
USUAL = 0.05  # weight of a frame in what is usual


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
        self._touching: Collection[str] = ()
        self._good = 0  # frames in a row since it was found again
        self._search: Search | None = None
        self._usual: dict[str, float] = {}  # [m] depth residual of each finger

    def expect(self, frames: Mapping[str, Frame]) -> None:
        """Takes frames of the grasp itself, to know how well depth fits when all is well."""
        self._learn_usual(self._fit(frames, np.eye(4), (0, 1)))

    def lose(self) -> None:
        """Too much time has passed: the track must be found again."""
        self.lost, self._good, self._search = True, 0, None

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
        """Where each finger's points are expected: first, last u, first, last v [px]; anywhere while it is lost."""
        if self.lost:
            return {m.finger: (0, m.camera.width, 0, m.camera.height) for m in self.models}
        out = {}
        for m in self.models:
            X = m.X_XC @ X_CT
            pixels = project32(m.camera, (X[:3, :3] @ m.p[:, ::7] + X[:3, 3:]).astype(np.float32))
            (u0, v0), (u1, v1) = pixels.min(axis=1).tolist(), pixels.max(axis=1).tolist()
            out[m.finger] = (_pixel(u0), _pixel(u1), _pixel(v0), _pixel(v1))
        return out

    def step(self, frames: Mapping[str, Frame], stamp: float, touching: Collection[str]) -> Fit:
        """The best fit to the frames; `lost` says whether it may be believed.

        touching: fingers whose depth shows a contact, wherever it is.
        """
        p, self._touching = self.parameters, touching
        start = self.predicted(stamp)
        steps = (COARSE_STEPS, p.iterations) if self.lost else (0, p.iterations)
        best = self._fit(frames, start, steps)
        quality = self._quality(best)
        if quality < p.lock:
            others = self._likely(frames) if self.lost else [start, self.X_CT]
            looked = [self._fit(frames, other, (COARSE_STEPS, 1)) for other in others]
            if looked:
                nearest = max(looked, key=_explained)
                best = max(best, self._fit(frames, nearest.X_CT, (0, p.iterations)), key=self._quality)
            quality = self._quality(best)
        locked = quality >= (p.lock + SURE if self.lost else p.lock)
        if locked or 0.0 < stamp - self.stamp <= SPAN:
            self.gross_slip |= self._watch.slides(frames, best, stamp, self.slip.value, locked)
        if quality < p.lock:
            best = max((best, *self._at_dots(frames)), key=self._quality)
            quality = self._quality(best)
        if quality >= p.lock and not self.lost:
            best = self._without_hidden(frames, best)
            quality = self._quality(best)
        self._accept(best, quality, stamp)
        return best

    def _without_hidden(self, frames: Mapping[str, Frame], found: Fit) -> Fit:
        """The fit without images that show something else: that something pulls at it."""
        hidden = [f for f in self._touching if found.locked[f] < HIDDEN]
        if not hidden:
            return found
        models = [m.without_image() if m.finger in hidden else m for m in self.models]
        steps = (0, self.parameters.iterations)
        return fit(models, frames, found.X_CT, self.slip.value, PRIOR, steps)

    def _at_dots(self, frames: Mapping[str, Frame]) -> list[Fit]:
        """Fits from where each finger's dots are: they may have sprung back, and the tool with them."""
        steps = (0, self.parameters.iterations)
        return [] if self.lost else [self._fit(frames, X_CT, steps) for X_CT in self._watch.places]

    def _fit(self, frames: Mapping[str, Frame], start: Array, steps: tuple[int, int]) -> Fit:
        return fit(self.models, frames, start, self.slip.value, PRIOR, steps)

    def _likely(self, frames: Mapping[str, Frame]) -> list[Array]:
        self._search = self._search or Search(self.models)
        return self._search.starts(frames)

    def _quality(self, result: Fit) -> float:
        """Share of the images explained by the motion; a motion that no tool makes explains nothing."""
        X = result.X_CT if self.lost else inverse_pose(self.X_CT) @ result.X_CT
        if not np.isfinite(X).all() or self._contradicted(result):
            return 0.0
        angle, way = float(np.linalg.norm(so3_log(X[:3, :3]))), float(np.linalg.norm(X[:3, 3]))
        most = RANGE if self.lost else REACH
        if angle > most[0] or way > most[1]:
            return 0.0
        shares = [result.locked[f] for f in self._touching]
        return max(result.locked.values()) if not self.lost else min(shares)

    def _contradicted(self, result: Fit) -> bool:
        """Whether a finger that touches something does not see the tool there, by its image or by its depth."""
        off = {f: rms > APART * self._usual.get(f, np.inf) for f, rms in result.depth_rms.items()}
        hidden = {f: share < HIDDEN for f, share in result.locked.items()}
        told = [f for f in self._touching if np.isfinite(result.depth_rms[f])]
        return not told or any(off[f] for f in told) or any(hidden[f] and f not in told for f in self._touching)

    def _accept(self, result: Fit, quality: float, stamp: float) -> None:
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
        self._learn_usual(result)
        if p.learn_slip and follow:
            self.slip.update(result.slip_step, result.slip_information, dt)

    def _learn_usual(self, result: Fit) -> None:
        for f, rms in result.depth_rms.items():
            if np.isfinite(rms):
                usual = self._usual.setdefault(f, rms)
                self._usual[f] = usual + USUAL * (min(rms, 2.0 * usual) - usual)

    def _rate(self, X_CT: Array, dt: float) -> Array:
        turn = so3_log(X_CT[:3, :3] @ self.X_CT[:3, :3].T)
        return np.concatenate([turn, X_CT[:3, 3] - self.X_CT[:3, 3]]) / dt


def _explained(result: Fit) -> float:
    return min(result.locked.values())


def _pixel(value: float) -> int:
    """A coordinate as a pixel's; 0 for one that cannot be told, far out for one that is."""
    return int(min(max(value, -1e5), 1e5)) if value == value else 0
