# SPDX-License-Identifier: Apache-2.0
"""Whether a grasp was taken without load: how far its patch has been dragged sideways since the bubble was free.

Deflections count from the grasp. A gripper that closes on a tool which something else carries pushes the membrane in,
along the axis y of C, and nothing sideways. A tool that hangs from the grasp, or is pressed, has dragged the membrane's
dots along x and z by load over stiffness: the zero is wrong by that much. The dots of the free membrane, which the
reference shows, and those in the patch tell how far.

A tool whose weight hangs beside the grasp has turned it as well: about y, on which it is hinged, both patches turn
alike; about x or z the two are dragged in opposite directions, by the turn times their distance.

A point q of the patch shows material that was at p on the free membrane: its place across y is that of q, less the
motion (t_x, t_z), a turn about y and the patch's stretch, which are searched for; its height is the free membrane's.
"""

from collections.abc import Mapping
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import cv2
import numpy as np

from seed_core.spatial import Array, cross, inverse_pose, length, make_pose, skew, so3_exp
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
MISJUDGED = 0.1  # [1] of a motion, standard deviation of what micro-slip makes of it
MISJUDGED_TURN = np.array((0.1, 0.25, 0.1))  # [1] likewise, of a turn
MOST_TURN = 0.2  # [rad] about x or z: fingers that differ by more are not dragged by one tool
PIVOT = 0.001  # [m] deviation, across y, of the point about which a tool turned from the patches' middle
NARROW = 0.006  # [m] of a tool: what the drags of closer patches differ by is no turn, but says how sure their mean is
STRETCH = 0.05  # [1] deviation of the patch's stretch
ANYWHERE = 0.1, 1.0  # [m], [rad] deviations of motion and twist before a dot is seen: they hold what shows none
NO_TURN = np.zeros(3)
UNTOLD = "whether the grasp was under load cannot be told"
_ITERATIONS = 12
_FIRM = np.diag((1e-4, 1e-4, 5e-3, 5e-3, 5e-3, 5e-3))  # steps of the numerical Jacobian: [m], [m], [rad], [1]
_ALONE = 1.0 / 6.0  # of neighbouring residuals counts as independent
_DONE = 5e-6  # [m] of a step


class Dragged(NamedTuple):
    """Sideways motion of a patch since its bubble was free.

    Attributes:
        motion: (2,) [m] of its middle along x and z of C, and twist: about y [rad].
        deviation: of each component of the motion [m].
        middle: (3,) [m] place of its middle in C.
        twist_deviation: of the twist [rad].
    """

    motion: Array
    twist: float
    deviation: float
    middle: Array
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
        turn, turn_deviation: (3,) [rad] about the axes of C; 0, 0 of one that is not turned.
        middles: (3,) [m] of each finger's patch, in C.
    """

    motion: Array
    deviation: float
    words: str = ""
    loaded: bool = False
    turn: Array = NO_TURN
    turn_deviation: Array = NO_TURN
    middles: Mapping[str, Array] = MappingProxyType({})

    @property
    def middle(self) -> Array:
        """(3,) [m] of all patches, in C."""
        return np.asarray(np.mean(list(self.middles.values()), axis=0))

    def motion_since_free(self) -> Array:
        """(4, 4) in C of the tool, which deflections of this grasp lack; none where it is not under load."""
        if not self.loaded:
            return np.eye(4)
        R = so3_exp(self.turn)
        return make_pose(R, self.middle - R @ (self.middle - self._shift))

    def part_since_free(self, finger: str, goes: Array, turns: float) -> Array:
        """(4, 4) in C of what goes along with a finger's patch by a share (3,) of its shift and a share of its turn."""
        if not self.loaded:
            return np.eye(4)
        shift, R = self.patch_shift(finger), so3_exp(turns * self.turn)
        before = self.middles[finger] - shift
        return make_pose(R, before + goes * shift - R @ before)

    def patch_shift(self, finger: str) -> Array:
        """(3,) [m] in C by which the middle of a finger's patch was dragged; none where it is not under load."""
        if not self.loaded:
            return np.zeros(3)
        after, X = self.middles[finger], inverse_pose(self.motion_since_free())
        return after - (X[:3, :3] @ after + X[:3, 3])

    @property
    def covariance(self) -> Array:
        """(6, 6) of [rotation vector, translation] that a shift and a turn about the middle bring with them."""
        if not self.loaded:
            return np.zeros((6, 6))
        of_turn = np.square(self.turn_deviation) + np.square(MISJUDGED_TURN * self.turn)
        J = np.vstack((np.eye(3), skew(self.middle)))
        covariance: Array = (J * of_turn) @ J.T
        of_shift = np.array((self.deviation, 0.0, self.deviation)), MISJUDGED * self._shift
        covariance[3:, 3:] += np.diag(np.square(of_shift).sum(axis=0))
        # dots do not show the way along y: whether it shifted or turned first, and about which point, is not known
        along_y = cross(self.turn, self._shift)[1], PIVOT * length(self.turn[::2])
        covariance[4, 4] += np.square(along_y).sum()
        return covariance

    @property
    def _shift(self) -> Array:
        return np.array((self.motion[0], 0.0, self.motion[1]))


def grasp_zero(fingers: Mapping[str, Dragged | None]) -> GraspZero:
    """What the patches of all fingers say together: a load drags both, so one alone tells nothing of it."""
    seen = {f: d for f, d in fingers.items() if d is not None}
    if not seen:
        return GraspZero(np.zeros(2), 0.0, f"{UNTOLD}: its dots are not those of the free bubble")
    if len(seen) < 2:
        return _of_one(next(iter(seen)), next(iter(seen.values())), len(fingers) > 1)
    return _of_both(seen)


def _of_one(finger: str, seen: Dragged, other: bool) -> GraspZero:
    """Of one finger; one bubble that is pressed aside looks the same. other: whether there is another one, unseen."""
    turned = abs(seen.twist) >= CLEAR * seen.twist_deviation
    if not other or not (turned or length(seen.motion) >= CLEAR * seen.deviation):
        return GraspZero(seen.motion, seen.deviation)
    about_y = np.array((0.0, float(turned), 0.0))
    way = _way(seen.motion, seen.deviation, about_y * seen.twist, about_y * seen.twist_deviation)
    dots = f"the {finger} membrane is dragged by {way}"
    return GraspZero(seen.motion, seen.deviation, f"{UNTOLD}: {dots}, and the other one's dots are not found")


def _of_both(seen: Mapping[str, Dragged]) -> GraspZero:
    """Of two fingers: what both show is shift and twist; their difference, a turn about x and z."""
    a, b = seen.values()
    motion, deviation = 0.5 * (a.motion + b.motion), float(np.hypot(a.deviation, b.deviation)) / np.sqrt(2.0)
    twist, uneven = 0.5 * (a.twist + b.twist), 0.5 * (a.twist - b.twist)
    dx, dy, dz = a.middle - b.middle
    apart = np.copysign(max(abs(dy), NARROW), dy)
    x, z = a.motion - b.motion
    turn = np.array(((z + twist * dx) / apart, twist, (twist * dz - x) / apart))
    of_twist = np.hypot(np.hypot(a.twist_deviation, b.twist_deviation) / np.sqrt(2.0), uneven)
    of_turn = np.hypot(a.deviation, b.deviation) / abs(apart)
    turn_deviation = np.array((of_turn, of_twist, of_turn))
    turned = np.abs(turn) >= CLEAR * turn_deviation
    turn, turn_deviation = np.where(turned, turn, 0.0), np.where(turned, turn_deviation, 0.0)
    if np.abs(turn[::2]).max() > MOST_TURN:
        ways = ", ".join(f"the {f} membrane is dragged by {_way(d.motion, d.deviation)}" for f, d in seen.items())
        most = max((a, b), key=lambda d: length(d.motion))
        return GraspZero(most.motion, most.deviation, f"{UNTOLD}: {ways}, and no tool does both")
    if abs(dy) < NARROW:
        turn[::2] = turn_deviation[::2] = 0.0
        deviation = float(np.hypot(deviation, length(a.motion - b.motion) / np.sqrt(8.0)))
    if length(motion) < CLEAR * deviation and not turn.any():
        return GraspZero(motion, deviation)
    way = _way(motion, deviation, turn, turn_deviation)
    words = f"the tool hangs or is pressed: the membranes are dragged by {way}"
    return GraspZero(motion, deviation, words, True, turn, turn_deviation, {f: d.middle for f, d in seen.items()})


def _way(motion: Array, deviation: float, turn: Array = NO_TURN, turn_deviation: Array = NO_TURN) -> str:
    """In words, for a person."""
    x, z = 1e3 * motion
    way = f"x {x:+.1f}, z {z:+.1f} +- {1e3 * deviation:.1f} mm in C"
    for axis, angle, sigma in zip("xyz", np.rad2deg(turn), np.rad2deg(turn_deviation), strict=True):
        if angle:
            way += f", and turned about its {axis} by {angle:+.1f} +- {sigma:.1f} degrees"
    return way


class FreeMembrane:
    """Where the material that is seen at points of the patch lay on the free membrane, in the reference's image.

    Attributes:
        middle: (3,) [m] mean of these points, in C.
    """

    def __init__(self, membrane: Membrane, points: Array) -> None:
        """points: (N, 3) of the patch in C [m]."""
        self._camera, self._rest, self._X_XC = membrane.camera, membrane.rest[..., 0], inverse_pose(membrane.X_CX)
        self._across, self._y = points[:, ::2], points[:, 1]
        self.middle: Array = points.mean(axis=0)

    def pixels(self, x: Array) -> Array32:
        """(2, N) [px] for (t_x, t_z [m], twist [rad], stretch along x, along z, and shear [1])."""
        off = self._across - self.middle[::2]
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
