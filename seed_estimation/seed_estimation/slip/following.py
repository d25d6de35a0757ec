# SPDX-License-Identifier: Apache-2.0
"""How far the membranes' material follows the tool from image to image: Coulomb's friction lets nothing spring back.

A patch that still sticks somewhere takes its material along: with two thirds of it sliding, material goes three
quarters of the tool's way. When all of it slides, the material stops where friction holds it, and the tool goes on.
Optical flow between two images tells the former to a few hundredths of a millimetre, however far the patch has been
dragged or torn since the grasp; depth tells the latter, with or without a track, where it sees the tool at all.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from seed_core.spatial import Array, inverse_pose, make_pose, so3_exp
from seed_estimation.images.sampling import Crop
from seed_estimation.images.tactile_images import Array32
from seed_estimation.images.tactile_images import Mask as Grey
from seed_estimation.rigid_fit.fit import Fit, fit
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import motion_vector
from seed_estimation.slip.markers import FREE, SIDEWAYS, THREE, Depth, sees

POINTS = 40  # of a patch that are followed
WINDOW, LEVELS, DONE = 13, 2, (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)  # of Lucas-Kanade's flow
FEWEST = 15  # of the points that must be found
GREY, CONTRAST = 128.0, 40.0  # 8-bit grey of a normalised image's 0, and of 1
PRIOR = np.diag([1 / 0.25**2] * 3 + [1 / 0.01**2] * 3)  # holds what depth does not see where it is expected
# Depth that is alone for long: what it sees worse than this (20 mrad, 0.5 mm) keeps less than half of its speed, for
# its noise, extrapolated, carries the place away along a cylinder's axis
COASTS = np.diag([1 / 0.02**2] * 3 + [1 / 5e-4**2] * 3)
DRAGGED = 6e-4  # [m] between the tool's pose and where depth would put it
STEPS = 6  # of depth's fit
MOVING, LATELY = 3e-4, 8  # [m] of the tool's way in so many images, from which on its material is looked at: that costs
MEMORY, PAUSE = 0.35, 0.1  # [s] that is looked back, and longest between two images
FRAMES = 3  # least of a way: depth may lag behind by one
WAY, SURE = 0.0008, 8.0  # [m], deviations of the tool's way that is long enough
LEFT, ONE_LEFT = 0.15, 0.3  # [1] of the tool's way, by which the fingers' mean and each of them may follow at most


class Step(NamedTuple):
    """What has moved from one image to the next.

    Attributes:
        stamp: of the later image [s].
        tool: where depth sees the tool.
        material: (fingers, 3) the step of each finger's material [m]; components as of `markers.Depth`.
    """

    stamp: float
    tool: Depth
    material: Array


class Following:
    """The material of all fingers in one grasp."""

    def __init__(self, models: Sequence[FingerModel], depths: Sequence[FingerModel], lever: Array) -> None:
        """depths: models without image; lever (3,): turn about y [rad], shift along x and z [m] to displacement [m]."""
        self._models, self._depths, self._lever = models, depths, lever
        self._points = [thinned(m.patch.points.p) for m in models]
        self._crops: Mapping[str, Crop] = {}  # of the last images, and their grey pictures where they were needed
        self._greys: dict[str, Grey] = {}
        self._tool: deque[Depth] = deque(maxlen=LATELY)
        self._places: deque[tuple[float, Array]] = deque(maxlen=2)  # [s], X_CT (4, 4) of the tool
        self._told: Array | None = None  # (6, 6) information about the last place, by depth alone; None: images know it
        self._steps: deque[Step] = deque()

    def slides(self, crops: Mapping[str, Crop], X_CT: Array | None, depth: Depth, stamp: float) -> bool:
        """Whether images at `stamp` [s] show that the tool goes without the material.

        X_CT: (4, 4) where the tool is, and depth: where depth alone would put it; None: the track is lost.
        """
        before, greys, self._crops, self._greys = self._crops, self._greys, crops, {}
        if X_CT is None or self._dragged(X_CT, depth):
            found = self._by_depth(crops, self._expected(stamp) if X_CT is None else X_CT)
            if found is None:
                self._forget()
                return False
            X_CT, depth = found
        else:
            self._told = None
        last = self._places[-1] if self._places else None
        self._places.append((stamp, X_CT))
        self._tool.append(depth)
        if last is None or not before or not 0.0 < stamp - last[0] <= PAUSE or not self._moves():
            self._steps.clear()
            return False
        greys = greys or {f: grey(c) for f, c in before.items()}
        self._greys = {f: grey(c) for f, c in crops.items()}
        moved = [
            self._moved(m, p, last[1], (before[m.finger], greys[m.finger]), (crops[m.finger], self._greys[m.finger]))
            for m, p in zip(self._models, self._points, strict=True)
        ]
        known = [m for m in moved if m is not None]
        if len(known) < len(moved):
            self._steps.clear()
            return False
        self._steps.append(Step(stamp, depth, np.array(known)))
        while stamp - self._steps[0].stamp > MEMORY:
            self._steps.popleft()
        return left_behind(self._steps)

    def _forget(self) -> None:
        self._steps.clear()
        self._places.clear()
        self._tool.clear()

    def _moves(self) -> bool:
        """Whether depth has seen the tool move lately."""
        return any(_way(before, self._tool[-1])[1] > MOVING for before in self._tool)

    def _dragged(self, X_CT: Array, depth: Depth) -> bool:
        """Whether the images hold the pose elsewhere than depth sees the tool: its residuals say too little then."""
        off = np.abs(depth.displacement - self._lever * motion_vector(X_CT)[SIDEWAYS])
        return bool((off[:2] > DRAGGED).any())

    def _expected(self, stamp: float) -> Array | None:
        """Where the tool should be now, had it kept its speed; None: nothing is known of it."""
        if not self._places:
            return None
        at, X = self._places[-1]
        if len(self._places) > 1:
            earlier, Y = self._places[0]
            step = motion_vector(inverse_pose(Y) @ X) * (stamp - at) / (at - earlier)
            if self._told is not None:
                step = np.asarray(np.linalg.solve(self._told + COASTS, self._told @ step), float)
            X = X @ make_pose(so3_exp(step[:3]), step[3:])
        return X

    def _by_depth(self, crops: Mapping[str, Crop], X: Array | None) -> tuple[Array, Depth] | None:
        """Where depth alone puts the tool; what it does not see stays as in X."""
        if X is None:
            return None
        found = by_depth(self._depths, crops, X)
        if found is None:
            return None
        self._told = found.H_depth
        deviation = np.sqrt(np.linalg.inv(found.H_depth[THREE] + FREE).diagonal())
        return found.X_CT, Depth(self._lever * motion_vector(found.X_CT)[SIDEWAYS], self._lever * deviation)

    def _moved(
        self, model: FingerModel, points: Array, X_CT: Array, before: tuple[Crop, Grey], now: tuple[Crop, Grey]
    ) -> Array | None:
        """Step (3,) of a finger's material [m] since the image before, when the tool was at X_CT; None: not found."""
        flow = flow_of(model, points, X_CT, before, now)
        return None if flow is None else self._lever * rigid_step(*flow)


def flow_of(
    model: FingerModel, points: Array, X_CT: Array, before: tuple[Crop, Grey], now: tuple[Crop, Grey]
) -> tuple[Array, Array] | None:
    """Where points (3, N) of a finger's material were in C in the image before (3, n), and their way along x and z
    since then (2, n) [m], of those that are found; None: too few.

    X_CT (4, 4): where the tool was, and they with it; before, now: the image's crop, and that in grey.
    """
    (a, first), (b, second) = before, now
    u0, v0 = (max(p, q) for p, q in zip(a.origin, b.origin, strict=True))
    h, w = (
        min(a.origin[1] + first.shape[0], b.origin[1] + second.shape[0]) - v0,
        min(a.origin[0] + first.shape[1], b.origin[0] + second.shape[1]) - u0,
    )
    if min(h, w) < 2 * WINDOW:
        return None
    first = first[v0 - a.origin[1] :, u0 - a.origin[0] :][:h, :w]
    second = second[v0 - b.origin[1] :, u0 - b.origin[0] :][:h, :w]
    X = model.X_XC @ X_CT
    P = X[:3, :3] @ points + X[:3, 3:]
    corner = np.array(((u0,), (v0,)), np.float32)
    pixels = np.ascontiguousarray((model.camera.project32(P.astype(np.float32)) - corner).T)
    inside = ((pixels > 2.0) & (pixels < np.array((w, h)) - 3.0)).all(axis=1)
    if np.count_nonzero(inside) < FEWEST:
        return None
    pixels, P, points = pixels[inside], P[:, inside], points[:, inside]
    after, good, _ = cv2.calcOpticalFlowPyrLK(
        first, second, pixels[:, None], pixels[:, None].copy(), None, None, (WINDOW, WINDOW), LEVELS, DONE
    )
    good = good[:, 0] > 0
    if np.count_nonzero(good) < FEWEST:
        return None
    flow = (after[:, 0] - pixels)[good].T * P[2, good] / model.camera.K.diagonal()[:2, None]
    way = (model.X_XC[:2, :3].T @ flow)[[0, 2]]
    place = (X_CT[:3, :3] @ points + X_CT[:3, 3:])[:, good]
    return place, way


def by_depth(depths: Sequence[FingerModel], crops: Mapping[str, Crop], X_CT: Array) -> Fit | None:
    """Where depth alone puts the tool; what it does not see stays as in X_CT (4, 4). None: a finger has no depth.

    depths: models without image.
    """
    found = fit(depths, crops, X_CT, 0.0, PRIOR, (0, STEPS))
    return found if all(math.isfinite(rms) for rms in found.depth_rms.values()) else None


def thinned(points: Array32) -> Array:
    """(3, POINTS) of points (3, N), evenly; none of none."""
    n = points.shape[1]
    return np.asarray(points[:, np.linspace(0, n - 1, POINTS if n else 0).astype(int)], float)


def grey(crop: Crop) -> Grey:
    return np.asarray(np.clip(GREY + CONTRAST * crop.fine, 0.0, 255.0), np.uint8)


def rigid_step(place: Array, way: Array) -> Array:
    """Turn about y [rad], shift along x and z [m] (3,) of points at `place` (3, N) that go `way` (2, N), robustly."""
    n = place.shape[1]
    A = np.zeros((2 * n, 3))
    A[:n, 0], A[n:, 0], A[:n, 1], A[n:, 2] = place[2], -place[0], 1.0, 1.0
    y, weight = way.ravel(), np.ones(2 * n)
    for _ in range(2):
        motion = np.linalg.solve(A.T @ (A * weight[:, None]) + 1e-12 * np.eye(3), A.T @ (weight * y))
        off = np.hypot(*(y - A @ motion).reshape(2, n))
        weight = np.tile(1.0 / (1.0 + np.square(off / max(3.0 * float(np.median(off)), 4e-5))), 2)
    return np.asarray(motion)


def _way(before: Depth, now: Depth) -> tuple[Array, float, float]:
    """The tool's way (3,) along what depth sees, its length, and the largest deviation of either end [m]."""
    deviation = np.maximum(before.deviation, now.deviation)
    seen = sees(deviation)
    way = np.where(seen, now.displacement - before.displacement, 0.0)
    return way, math.hypot(*way), float(deviation[seen].max(initial=0.0))


def left_behind(steps: Sequence[Step]) -> bool:
    """Whether the tool has gone a way that depth sees, and the material of every finger a small share of it."""
    now = steps[-1]
    total = np.zeros_like(now.material)
    for n in range(1, len(steps)):
        total += steps[-n].material
        before = steps[-1 - n]
        way, length, deviation = _way(before.tool, now.tool)
        if n < FRAMES or length < max(WAY, SURE * deviation):
            continue
        shares = total @ way / length**2
        if shares.mean() < LEFT and shares.max() < ONE_LEFT:
            return True
    return False
