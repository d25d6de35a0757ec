# SPDX-License-Identifier: Apache-2.0
"""Relocalisation of a lost tool: its patches are looked for in the whole of both images, at several turns.

The image of the grasp, turned in its plane, is correlated with the new one at half the resolution. Where each bubble's
patch is found, depth gives a point; two points and the turn make a pose of all six axes, good enough to start a fit.
"""

from collections.abc import Mapping, Sequence
from itertools import cycle

import cv2
import numpy as np

from seed_core.spatial import Array, inverse_pose, make_pose, so3_exp
from seed_estimation.images.sampling import Crop
from seed_estimation.images.tactile_images import Image
from seed_estimation.rigid_fit.reference import FingerModel

HALF = 2  # [px] step of the search
TURNS = np.deg2rad((0, -7, 7, -14, 14, -21, 21, -28, 28, -35, 35, -42, 42))  # a blurred patch is found 4 degrees off
PER_FRAME = 5  # turns looked at per pair of images: one camera period is not enough for all
STARTS = 2  # of them that are worth a fit
WINDOW = 4  # [px] around a place in which depth is averaged
NEAREST, FARTHEST = 0.02, 0.2  # [m] of a membrane
TILT = np.cos(0.7)  # [1] no tool leans further


class Relocaliser:
    """Looks for a lost tool, some turns per frame, the smallest first, over and over."""

    def __init__(self, models: Sequence[FingerModel]) -> None:
        axis = models[0].X_XC[2, :3]
        self._axis = axis / np.linalg.norm(axis)  # in C, about which the tool is turned: the cameras' optical axis
        self._templates = [_PatchTemplates(m, self._axis) for m in models]
        self._turns = cycle(range(len(TURNS)))

    def starts(self, crops: Mapping[str, Crop]) -> list[Array]:
        """Likely poses X_CT (4, 4), best first; crops: of whole images, by finger."""
        halves = [
            cv2.copyMakeBorder(_halved(crops[t.model.finger].coarse), *[t.reach] * 4, cv2.BORDER_CONSTANT)
            for t in self._templates
        ]
        out = []
        for turn in (next(self._turns) for _ in range(PER_FRAME)):
            found = [
                (t.p, *place)
                for t, half in zip(self._templates, halves, strict=True)
                if (place := t.place(half, crops[t.model.finger], turn)) is not None
            ]
            R = so3_exp(TURNS[turn] * self._axis)
            X = _pose_from_points([before for before, _, _ in found], [after for _, after, _ in found], R)
            if X is not None:
                out.append((sum(score for _, _, score in found), X))
        return [X for _, X in sorted(out, key=lambda item: -item[0])[:STARTS]]


class _PatchTemplates:
    """One finger's patch at the grasp, at every turn."""

    def __init__(self, model: FingerModel, axis: Array) -> None:
        self.model = model
        middle = model.p.mean(axis=1, keepdims=True)
        self.p = model.p[:, int(np.argmin(np.square(model.p - middle).sum(axis=0)))].astype(float)
        u, v = model.pixels(np.eye(4), self.p[:, None])[:, 0] / HALF
        half = _halved(model.picture)
        rows, columns = np.nonzero(half)
        # from the patch's middle to its furthest pixel [halved px]
        self.reach = int(np.sqrt((np.square(rows - v) + np.square(columns - u)).max())) + 1
        sign = float(model.X_XC[2, :3] @ axis)  # the two cameras look at each other
        self._templates = [_turned(half, (u, v), self.reach, float(np.rad2deg(turn * sign))) for turn in TURNS]

    def place(self, half: Image, crop: Crop, turn: int) -> tuple[Array, float] | None:
        """The patch's likeliest middle (3,) in C [m], and its score, in a halved image framed by `reach` pixels."""
        scores = cv2.matchTemplate(half, self._templates[turn], cv2.TM_CCORR)
        _, score, _, (u, v) = cv2.minMaxLoc(scores)
        row, column = HALF * v, HALF * u
        window = crop.depth[max(0, row - WINDOW) : row + WINDOW + 1, max(0, column - WINDOW) : column + WINDOW + 1]
        seen = window[(window > NEAREST) & (window < FARTHEST)]
        if not seen.size:
            return None
        ray = self.model.camera.pixel_rays((column + crop.origin[0], row + crop.origin[1]))
        X_CX = inverse_pose(self.model.X_XC)
        return X_CX[:3, :3] @ (ray * float(np.median(seen))) + X_CX[:3, 3], float(score)


def _pose_from_points(before: Sequence[Array], after: Sequence[Array], R: Array) -> Array | None:
    """X (4, 4) that turns by R and takes points (3,) from before to after; with two, R is tilted to fit them."""
    if not before:
        return None
    if len(before) == 2:
        a, b = R @ (before[1] - before[0]), after[1] - after[0]
        cosine = float(a @ b) / float(np.linalg.norm(a) * np.linalg.norm(b) + 1e-12)
        if cosine < TILT:
            return None
        axis = np.cross(a, b)
        size = float(np.linalg.norm(axis))
        R = so3_exp(axis / size * np.arccos(min(cosine, 1.0))) @ R if size > 1e-12 else R
    return make_pose(R, np.mean(after, axis=0) - R @ np.mean(before, axis=0))


def _halved(image: Image) -> Image:
    return np.asarray(cv2.resize(image, None, fx=1 / HALF, fy=1 / HALF, interpolation=cv2.INTER_AREA), np.float32)


def _turned(half: Image, centre: tuple[float, float], reach: int, degrees: float) -> Image:
    """The patch (2 reach + 1)^2 around its centre, turned from the image's right to downwards."""
    M = cv2.getRotationMatrix2D((float(centre[0]), float(centre[1])), -degrees, 1.0)
    M[:, 2] += reach - np.asarray(centre, float)
    side = 2 * reach + 1
    return np.asarray(cv2.warpAffine(half, M, (side, side), flags=cv2.INTER_LINEAR), np.float32)
