# SPDX-License-Identifier: Apache-2.0
"""The markers (printed dots) of one finger, followed without depth: they show where the membrane is."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp, so3_log
from seed_estimation.images.sampling import Crop
from seed_estimation.images.tactile_images import Bools
from seed_estimation.rigid_fit.fit import Fit, fit
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import FingerResiduals, motion_vector, solved
from seed_estimation.slip.incipient import creep_weights, incipient_slip

SIDEWAYS = np.array((1, 3, 5))  # turn about y, displacement along x and z: what friction bears
THREE = np.ix_(SIDEWAYS, SIDEWAYS)
# Keeps roll, yaw and y, which the markers of one finger hardly show
HOLD = np.diag((1e9, 4.0, 1e9, 2.5e3, 1e12, 2.5e3))
FREE_ALL = np.diag((4.0, 4.0, 4.0, 2.5e3, 2.5e3, 2.5e3))  # holds what depth does not see
FREE = FREE_ALL[THREE]  # the same of the three alone
SPAN, RELEASE = 0.12, 0.5  # [s] that is looked back; the same for the load under which a tool was, which is let go
JITTER = 3e-5  # [m] that noise is taken for at first
BACK = (0.0, 0.1, 0.2, 0.3, 0.4, 0.7, 1.0)  # shares of the displacement by which they are searched for; 1: set free
DOUBT, DOUBT_SURE = 0.03, 3.0  # [1], spreads; less explained than usual: the patch does not move as one
USUAL, QUIET = 0.1, 0.02  # [1] weights of a frame in what is usual, and in what is noise
# [1] times the deviation of the direction that depth sees best, and [m] at most, up to which it sees a direction. It
# only pretends to see a cylinder's own axis (2.6 times and more) and along a wide flat face; across a round tool or a
# box, and in a round tool's turns, it is 1.4 times at most, at any noise. A box's turn is seen to 0.5 mm at its reach.
AS_WELL, SEEN = 1.6, 3e-4
FOUND, CLEAR = 0.5, 0.8  # [1] of the image that the markers must explain; from which on nothing is searched


class Depth(NamedTuple):
    """Where depth alone would put the tool: displacement (3,) [m] like that of the markers, and deviation (3,) [m]."""

    displacement: Array
    deviation: Array


def sees(deviation: Array) -> Bools:
    """Which directions depth sees (3,), by its deviations (3,) [m]: noise makes all of them larger alike."""
    return np.asarray(deviation < min(AS_WELL * float(deviation.min()), SEEN))


UNSEEN = Depth(np.zeros(3), np.ones(3))


class Observation(NamedTuple):
    """The markers of one finger in one frame.

    Attributes:
        stamp: of the frame [s].
        displacement: (3,) since the grasp [m]: turn about y at the patch's reach, along x, along z.
        size: length of the displacement [m].
        depth: where depth would put the tool in this frame.
        incipient: incipient slip [1].
        doubtful: less of the image is explained than usual.
        loss: how much less the tool's pose explains than usual [1]; 1 where no pose is known.
    """

    stamp: float
    displacement: Array
    size: float
    depth: Depth
    incipient: float
    doubtful: bool
    loss: float


class Markers:
    """Those of one finger, in one grasp.

    Attributes:
        seen: observations of the last SPAN seconds.
        sizes: of the displacements of the last RELEASE seconds: stamp [s], size [m].
        X_CT: (4, 4) where they would put the tool, when last found.
        side: y of the patch at the grasp [m].
        jitter: deviation of the displacement's second difference over frames [m].
    """

    def __init__(self, model: FingerModel, lever: Array, centre: Array) -> None:
        """lever (3,): turn about y [rad], shift along x and z [m] to displacement [m]; centre: see `sideways`."""
        self._model, self._lever, self._centre = model.without_depth(), lever, centre
        self.side = float(model.patch.points.p[1].mean())
        self._creep = creep_weights(model)
        self.seen: deque[Observation] = deque()
        self.sizes: deque[tuple[float, float]] = deque()
        self.X_CT = np.eye(4)
        self.jitter = JITTER
        self._usual = 0.0  # [1] how much of the image is explained while the tool sticks
        self._spread = 0.0  # [1] how far it strays from that

    def forget(self, stamp: float) -> None:
        """Drops what lies too long before a time [s], or after it: the clock was set back."""
        while self.seen and not 0.0 <= stamp - self.seen[0].stamp <= SPAN:
            self.seen.popleft()
        while self.sizes and not 0.0 <= stamp - self.sizes[0][0] <= RELEASE:
            self.sizes.popleft()

    def follow(
        self, crop: Crop, near: Array, known: FingerResiduals | None, slip: float, stamp: float, depth: Depth
    ) -> bool:
        """Whether the markers are found in a frame at `stamp` [s]; they are then added to `seen`.

        near: X_CT (4, 4) about where they may be; known: residuals that were evaluated there, if any; slip: micro-slip
        [1]; depth: where it would put the tool.
        """
        explained = known.explained() if known is not None else 0.0
        loss = self._usual - explained if known is not None else 1.0
        if known is None or self._doubts(explained):
            found = self._search(crop, near, slip)
            if found is None:
                return False
            near, known, explained = found.X_CT, found.fingers[0], _explained(found)
        self.X_CT = near
        # the image alone asks to change the three by H^-1 g, the other axes held
        step = solved(known.image.H[THREE] + FREE, known.image.g[SIDEWAYS])
        displacement = self._lever * (sideways(near, self._centre) - step)
        incipient = incipient_slip(known, motion_vector(near), self._creep, HOLD)
        size, doubtful = math.hypot(*displacement), self._doubts(explained)
        self.seen.append(Observation(stamp, displacement, size, depth, incipient, doubtful, loss))
        self.sizes.append((stamp, size))
        self._learn(explained)
        return True

    def _doubts(self, explained: float) -> bool:
        return explained < self._usual - DOUBT - DOUBT_SURE * self._spread

    def _search(self, crop: Crop, near: Array, slip: float) -> Fit | None:
        """The markers near where they may be, where they were last or further back; None: not found."""

        def fitted(start: Array, steps: tuple[int, int]) -> Fit:
            return fit([self._model], {self._model.finger: crop}, start, slip, HOLD, steps)

        found = fitted(near, (0, 4))
        if _explained(found) > CLEAR:
            return found
        starts = [near, *(_eased(self.X_CT, share) for share in BACK)]
        best = max((fitted(start, (3, 1)) for start in starts), key=_explained)
        found = fitted(best.X_CT, (3, 8))
        return found if _explained(found) > FOUND else None

    def _learn(self, explained: float) -> None:
        """What is usual, and what is noise; what slides is not."""
        if len(self.seen) < 2 and self._usual == 0.0:
            self._usual = explained
        less = min(self._usual - explained, 2.0 * DOUBT)
        self._usual -= USUAL * less
        self._spread += USUAL * (abs(less) - self._spread)
        if len(self.seen) > 2:
            a, b, c = (self.seen[i].size for i in (-3, -2, -1))
            change = min(abs(c - 2.0 * b + a), 2.0 * self.jitter)  # a sudden pull is no noise
            self.jitter = math.sqrt(self.jitter**2 + QUIET * (change**2 - self.jitter**2))


def sideways(X_CT: Array, centre: Array) -> Array:
    """Turn about y [rad] and shift along x and z [m] (3,) of the tool's point `centre` (3,), on the y axis."""
    shift = X_CT[:3, :3] @ centre + X_CT[:3, 3] - centre
    return np.array((so3_log(X_CT[:3, :3])[1], shift[0], shift[2]))


def _explained(found: Fit) -> float:
    return next(iter(found.explained.values()))


def _eased(X_CT: Array, share: float) -> Array:
    """X_CT with so much of its sideways motion since the grasp taken back."""
    motion = motion_vector(X_CT)
    motion[SIDEWAYS] *= 1.0 - share
    return make_pose(so3_exp(motion[:3]), motion[3:])
