# SPDX-License-Identifier: Apache-2.0
"""Whether a grasp was taken without load: how far its patch has been dragged sideways since the bubble was free.

Deflections count from the grasp. A gripper that closes on a tool which something else carries pushes the membrane in,
along the axis y of C, and nothing sideways. A tool that hangs from the grasp, or is pressed, has dragged the membrane's
dots along x and z by load over stiffness: the zero is wrong by that much. The dots of the free membrane, which the
reference shows, and those in the patch tell how far.

A tool whose weight hangs beside the grasp has turned it as well, about y most of all, on which it is hinged.

A point q of the patch shows material that was at p on the free membrane: its place across y is that of q, less the
motion (t_x, t_z), a turn about y and the patch's stretch, which are searched for; its height is the free membrane's.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np

from seed_core.spatial import Array, inverse_pose, length, make_pose, so3_exp
from seed_estimation.contact.membrane import Membrane
from seed_estimation.contact.surface import surface
from seed_estimation.images.normalise import coarse, normalised
from seed_estimation.images.sampling import sample
from seed_estimation.images.tactile_images import Array32, Image, Mask

REACH, STEP = 0.008, 0.0008  # [m] of the search, and between its places
TURNS = -0.2, 0.0, 0.2  # [rad] that it tries
POINTS, SEARCHED = 900, 250  # of the patch, for the motion and for the search
BORDER = 3  # [px] cut off along the patch
ALIKE, SURE = 0.6, 0.85  # [1] correlation from which on the dots may be the same, and from which on nothing is searched
TRUST = 1e-4  # [m] standard deviation that a good match still has: the membrane need not go in straight
TRUST_TURN = 0.005  # [rad] likewise, of the turn
CLEAR = 2.5  # deviations from which on a motion counts
MISJUDGED, MISJUDGED_TURN = (
    0.1,
    0.25,
)  # [1] of a motion, and of a turn, standard deviation of what micro-slip makes of it
STRETCH = 0.05  # [1] deviation of the patch's stretch
ANYWHERE = 0.1, 1.0  # [m], [rad] deviations of motion and twist before a dot is seen: they hold what shows none
_ITERATIONS = 12
_FIRM = np.diag((1e-4, 1e-4, 5e-3, 5e-3, 5e-3, 5e-3))  # steps of the numerical Jacobian: [m], [m], [rad], [1]
_ALONE = 1.0 / 6.0  # of neighbouring residuals counts as independent
_DONE = 5e-6  # [m] of a step


class Dragged(NamedTuple):
    """Sideways motion of a patch since its bubble was free.

    Attributes:
        motion: (2,) [m] of its middle along x and z of C, and twist: about y [rad].
        deviation: of each component of the motion [m].
        middle: (2,) [m] place of its middle along x and z of C.
        twist_deviation: of the twist [rad].
    """

    motion: Array
    twist: float
    deviation: float
    middle: Array = np.zeros(2)
    twist_deviation: float = TRUST_TURN


def dragged(membrane: Membrane, free: Image, depth: Image, ir: Image, patch: Mask) -> Dragged | None:
    """How far a patch was dragged; None where its dots are not found on the free membrane.

    Args:
        free: (H, W) infrared of the reference [counts]. depth, ir: (H, W) of the grasp [m], [counts].
        patch: (H, W) where the membrane lies on the tool.
    """
    side = 2 * BORDER + 1
    inner = cv2.erode(patch, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), borderValue=0)
    q, _ = surface(membrane.camera, depth, np.isfinite(depth) & (inner > 0), 1.5)
    v, u = np.nonzero(np.isfinite(q).all(axis=2) & (inner > 0))
    if v.size < 60:
        return None
    some = np.unique(np.linspace(0, v.size - 1, min(POINTS, v.size)).astype(int))
    v, u = v[some], u[some]
    R, o = membrane.X_CX[:3, :3], membrane.X_CX[:3, 3]
    points, fine = q[v, u].astype(float) @ R.T + o, normalised(ir)[v, u]
    few = slice(None, None, max(v.size // SEARCHED, 1))
    seen, pictures = FreeMembrane(membrane, points), (coarse(free), normalised(free))
    broad = coarse(ir)[v, u]
    x, deviations, alike = _refined(seen, pictures, (broad, fine), np.zeros(6))
    if alike < SURE:
        start = _searched(FreeMembrane(membrane, points[few]), pictures[0], broad[few])
        x, deviations, alike = max((x, deviations, alike), _refined(seen, pictures, (broad, fine), start), key=_alike)
    if alike < ALIKE or float(np.abs(x[:2]).max()) > REACH:
        return None
    way, turn = np.hypot(deviations, (TRUST, TRUST_TURN))
    return Dragged(x[:2].copy(), float(x[2]), float(way), seen.middle, float(turn))


class GraspZero(NamedTuple):
    """Where the tool was when its grasp was taken, from where it would be without load.

    Attributes:
        motion: (2,) [m] along x and z of C of the patches' middle, and deviation: of each [m].
        words: '' where nothing was dragged; else what was seen, or why it could not be.
        loaded: whether the grasp was under load, as far as one sees.
        twist, twist_deviation: [rad] about y of C, and middle: (2,) [m] of the patches along x and z of C.
    """

    motion: Array
    deviation: float
    words: str = ""
    loaded: bool = False
    twist: float = 0.0
    twist_deviation: float = 0.0
    middle: Array = np.zeros(2)

    def motion_since_free(self, goes: Array | float = 1.0, turns: float = 1.0) -> Array:
        """(4, 4) in C, which deflections of this grasp lack; none where it is not under load.

        goes, turns: share of the shift (3,) and of the turn, of what goes along with the tool in part.
        """
        if not self.loaded:
            return np.eye(4)
        (x, z), (t_x, t_z) = self.middle, self.motion
        turn = make_pose(so3_exp(np.array((0.0, turns * self.twist, 0.0))))
        there, shift = np.array((x - t_x, 0.0, z - t_z)), np.array((t_x, 0.0, t_z))
        return make_pose(turn[:3, :3], there + goes * shift - turn[:3, :3] @ there)

    @property
    def covariance(self) -> Array:
        """(6, 6) of [rotation vector, translation] that a shift brings with it."""
        variance = np.zeros(6)
        if self.loaded:
            variance[[3, 5]] = self.deviation**2 + np.square(MISJUDGED * self.motion)
            if self.twist:
                variance[1] = self.twist_deviation**2 + (MISJUDGED_TURN * self.twist) ** 2
                variance[[3, 5]] += variance[1] * np.square(self.middle[::-1])
        return np.diag(variance)


def grasp_zero(fingers: Mapping[str, Dragged | None]) -> GraspZero:
    """What the patches of all fingers say together: a load drags both alike, so one alone tells nothing of it."""
    seen = {f: d for f, d in fingers.items() if d is not None}
    if not seen:
        unknown = "whether the grasp was under load cannot be told: its dots are not those of the free bubble"
        return GraspZero(np.zeros(2), 0.0, unknown)
    motion, deviation = _together([d.motion for d in seen.values()], [d.deviation for d in seen.values()])
    turn, turn_deviation = _together([d.twist for d in seen.values()], [d.twist_deviation for d in seen.values()])
    (x, z), twist = 1e3 * motion, float(turn)
    way = f"x {x:+.1f}, z {z:+.1f} +- {1e3 * deviation:.1f} mm in C"
    moved, turned = length(motion) >= CLEAR * deviation, abs(twist) >= CLEAR * turn_deviation
    if turned:
        way += f", and turned about its y by {np.rad2deg(twist):+.1f} +- {np.rad2deg(turn_deviation):.1f} degrees"
    if len(fingers) < 2 or not (moved or turned):  # one bubble that is pressed aside looks the same
        return GraspZero(motion, deviation)
    if len(seen) < len(fingers):
        dots = f"the {next(iter(seen))} membrane is dragged by {way}, and the other one's dots are not found"
        return GraspZero(motion, deviation, f"whether the grasp was under load cannot be told: {dots}")
    words, middle = f"the tool hangs or is pressed: the membranes are dragged by {way}", _middle(seen.values())
    return GraspZero(motion, deviation, words, True, twist if turned else 0.0, turn_deviation, middle)


def _together(values: Sequence[Array] | Sequence[float], deviations: Sequence[float]) -> tuple[Array, float]:
    """Mean over the fingers, and the deviation of each component: their own, and by what they differ."""
    each = np.array(values)
    mean = each.mean(axis=0)
    return mean, float(np.sqrt(np.mean(np.square(deviations)) + np.square(each - mean).mean()))


def _middle(seen: Iterable[Dragged]) -> Array:
    return np.asarray(np.mean([d.middle for d in seen], axis=0))


class FreeMembrane:
    """Where the material that is seen at points of the patch lay on the free membrane, in the reference's image.

    Attributes:
        middle: (2,) [m] mean of these points along x and z of C.
    """

    def __init__(self, membrane: Membrane, points: Array) -> None:
        """points: (N, 3) of the patch in C [m]."""
        self._camera, self._rest, self._X_XC = membrane.camera, membrane.rest[..., 0], inverse_pose(membrane.X_CX)
        self._across, self._y = points[:, ::2], points[:, 1]
        self.middle = self._across.mean(axis=0)

    def pixels(self, x: Array) -> Array32:
        """(2, N) [px] for (t_x, t_z [m], twist [rad], stretch along x, along z, and shear [1])."""
        off = self._across - self.middle
        c, s = 1.0 - np.cos(x[2]), np.sin(x[2])
        turn = np.array(((x[3] + c, x[5] + s), (x[5] - s, x[4] + c)))  # about y: x by +z, z by -x
        across = self._across - x[:2] - off @ turn.T
        p = np.stack((across[:, 0], self._y, across[:, 1]), axis=1)
        R, o = self._X_XC[:3, :3], self._X_XC[:3, 3]
        axis = R[:, 1]  # of y, in the optical frame
        P = p @ R.T + o
        for _ in range(4):  # along y to the free membrane
            pixels = self._camera.project32(P.T.astype(np.float32))
            gap = sample(self._rest, pixels).astype(float) - P[:, 2]
            gap = np.where(np.abs(gap) < 0.03, gap, 0.0)
            P = P + (gap / axis[2])[:, None] * axis
        return self._camera.project32(P.T.astype(np.float32))


def _searched(seen: FreeMembrane, free: Image, values: Array32) -> Array:
    """The best motion and turn of a grid, without stretch."""
    steps = np.arange(-REACH, REACH + 0.5 * STEP, STEP)
    best, found = -1.0, np.zeros(6)
    for t_x, t_z, turn in product(steps, steps, TURNS):
        x = np.array((t_x, t_z, turn, 0.0, 0.0, 0.0))
        alike = _correlation(sample(free, seen.pixels(x)), values)
        if alike > best:
            best, found = alike, x
    return found


def _refined(
    seen: FreeMembrane, pictures: tuple[Image, Image], values: tuple[Array32, Array32], x: Array
) -> tuple[Array, tuple[float, float], float]:
    """Gauss-Newton on the coarse, then the fine picture: motion, deviations [m], [rad], and how alike the dots are."""
    way, turn = ANYWHERE
    prior, deviations = np.diag((way**-2, way**-2, turn**-2, *(STRETCH**-2,) * 3)), ANYWHERE
    for free, value in zip(pictures, values, strict=True):
        for _ in range(_ITERATIONS):
            r = sample(free, seen.pixels(x)) - value
            ahead = [(sample(free, seen.pixels(x + d)), sample(free, seen.pixels(x - d)), d.sum()) for d in _FIRM]
            J = np.stack([(a - b) / (2.0 * d) for a, b, d in ahead])
            s = max(1.4826 * float(np.median(np.abs(r))), 0.05)
            w = _ALONE / np.square(s) / (1.0 + np.square(r / (2.0 * s)))
            H = (J * w) @ J.T + prior
            change = np.linalg.solve(H, (J * w) @ r + prior @ x)
            x, variance = x - change, np.linalg.inv(H).diagonal()
            deviations = float(np.sqrt(variance[:2].mean())), float(np.sqrt(variance[2]))
            if float(np.abs(change[:2]).max()) < _DONE:
                break
    return x, deviations, _correlation(sample(pictures[1], seen.pixels(x)), values[1])


def _alike(found: tuple[Array, tuple[float, float], float]) -> float:
    return found[2]


def _correlation(a: Array32, b: Array32) -> float:
    good = np.abs(a) < 50.0
    if np.count_nonzero(good) < 0.7 * a.size:
        return -1.0
    a, b = a[good], b[good]
    return float(a @ b / np.sqrt(float(a @ a) * float(b @ b) + 1e-12))
