# SPDX-License-Identifier: Apache-2.0
"""Images of two such bubbles: rays are marched onto the height field, dots are hard discs at random places."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from seed_core.hand import FINGERS, Hand
from seed_core.spatial import Array
from seed_estimation import PinholeCamera, TactileImages
from seed_testing.validation.other_renderer.sheet import STEP, Field, Held, Sheet

K = np.array(((214.06, 0.0, 116.25), (0.0, 214.06, 87.57), (0.0, 0.0, 1.0)))
D = np.array((0.368, -4.494, 0.0, 0.0, 7.971))
SIZE = 224, 171  # [px]
CELL = 1e-4  # [m] of the printed sheet's picture
SQUEEZE = 0.006  # [m]
MARCHES = 6
NO_MOTION, UNIT = (np.zeros(3), np.zeros(3)), np.eye(3)


@dataclass(frozen=True)
class Camera:
    """How a camera differs from what it is taken for: focal length and scale of depth as shares, offset [m]."""

    focal: float = 0.0
    scale: float = 0.0
    offset: float = 0.0


class Bubble:
    """One bubble and its camera."""

    def __init__(self, sheet: Sheet, X_CX: Array, camera: Camera, rng: np.random.Generator) -> None:
        self.sheet, self._camera, self._rng = sheet, camera, rng
        v, u = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float64)
        lens = K * (1.0 + camera.focal)
        lens[:2, 2], lens[2, 2] = K[:2, 2], 1.0
        seen = np.stack(((u.ravel() - lens[0, 2]) / lens[0, 0], (v.ravel() - lens[1, 2]) / lens[1, 1]))
        flat = seen.copy()
        for _ in range(40):  # OpenCV's own steps are too few for this lens
            flat += 0.7 * (
                seen - cv2.projectPoints(np.stack((*flat, np.ones(flat.shape[1]))).T, *NO_MOTION, UNIT, D)[0][:, 0].T
            )
        rays = np.concatenate((flat, np.ones((1, flat.shape[1]))))
        self._origin, self._rays = X_CX[:3, 3], (X_CX[:3, :3] @ rays).astype(np.float32).reshape(3, *u.shape)
        self._length = np.linalg.norm(rays, axis=0).reshape(u.shape).astype(np.float32)
        self._side = float(np.sign(X_CX[1, 3]))
        self._print = printed(sheet, rng)
        self._pattern = (0.0005 * texture(rng, 1.3) + 0.0001 * texture(rng, 14.0)).astype(np.float32)
        self._drift = texture(rng, 4.0)
        self._depth = np.full(u.shape, 0.09, np.float32)

    def images(self, stamp: float) -> TactileImages:
        """Of the sheet as it is."""
        s, o = self.sheet, self._origin.astype(np.float32)
        depth = self._depth
        for _ in range(MARCHES):
            x, z = self._grid(depth)
            w = cv2.remap(s.w, x, z, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            depth = (self._side * w - o[1]) / self._rays[1]
        self._depth = depth
        x, z = self._grid(depth)
        moved = [cv2.remap(d, x, z, cv2.INTER_LINEAR) for d in s.shift]
        column, row = ((g * np.float32(STEP) - d) / np.float32(CELL) for g, d in zip((x, z), moved, strict=True))
        ink = cv2.remap(self._print, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        slopes = [cv2.remap(g.astype(np.float32), x, z, cv2.INTER_LINEAR) for g in np.gradient(s.w, STEP)]
        lit = 1.0 / np.sqrt(1.0 + slopes[0] ** 2 + slopes[1] ** 2)
        ir = 880.0 * ink * (0.3 + 0.7 * lit) * (0.095 / (depth * self._length)) ** 2 / self._length**3
        ir += np.sqrt(np.maximum(ir, 1.0)) * 0.35 * self._rng.standard_normal(ir.shape)
        return TactileImages(self._measured(depth), np.rint(np.maximum(ir, 0.0)).astype(np.float32), stamp)

    def _grid(self, depth: Field) -> tuple[Field, Field]:
        """Columns and rows of the sheet's grid at depth (H, W)."""
        at = [
            (self._origin[i] + self._rays[i] * depth - o) / STEP for i, o in zip((0, 2), self.sheet.origin, strict=True)
        ]
        return at[0].astype(np.float32), at[1].astype(np.float32)

    def _measured(self, depth: Field) -> Field:
        """With what the camera gets wrong."""
        self._drift = 0.9 * self._drift + 0.436 * texture(self._rng, 4.0)
        mixed = cv2.GaussianBlur(depth, (0, 0), 0.7)  # of the light within a pixel
        out = mixed + self._pattern + 5e-5 * self._drift + 0.0004 * self._rng.standard_normal(depth.shape)
        out = (1.0 + self._camera.scale) * out + self._camera.offset
        out[self._rng.random(depth.shape) < 2e-4] = np.nan
        return np.asarray(out, np.float32)


def texture(rng: np.random.Generator, blur: float) -> Field:
    """(H, W) noise of unit deviation, smooth over so many pixels."""
    field = cv2.GaussianBlur(rng.standard_normal((SIZE[1], SIZE[0])).astype(np.float32), (0, 0), blur)
    return np.asarray(field / field.std(), np.float32)


def printed(sheet: Sheet, rng: np.random.Generator) -> Field:
    """The sheet's picture: discs that keep 2.4 mm from each other, at random, no two of one size and grey."""
    h, w = (int(n * STEP / CELL) for n in sheet.rest.shape)
    out = np.ones((h, w), np.float32)
    taken: list[Array] = []
    for place in rng.uniform((0, 0), (w, h), (4000, 2)):
        if taken and np.min(np.sum(np.square(np.array(taken) - place), axis=1)) < (0.0024 / CELL) ** 2:
            continue
        taken.append(place)
        centre, radius = (int(16 * place[0]), int(16 * place[1])), int(16 * rng.uniform(5.0, 8.0))
        cv2.circle(out, centre, radius, float(rng.uniform(0.35, 0.6)), -1, cv2.LINE_8, 4)
    return np.asarray(cv2.GaussianBlur(out, (0, 0), 2.0), np.float32)


class OtherRenderer:
    """Both bubbles; the first pose that is rendered is the grasp."""

    def __init__(self, held: Held, hand: Hand, seed: int, wrong: Mapping[str, Camera] | None = None) -> None:
        """hand: as it is, not as believed; wrong: what else is not as believed, by finger."""
        rng, wrong = np.random.default_rng((seed, 31)), wrong or {}
        self.cameras = {f: PinholeCamera(*SIZE, K, D, "plumb_bob") for f in FINGERS}
        self.bubbles = {
            f: Bubble(Sheet(held, side, (0.055, 0.041), 0.028, SQUEEZE, 0.0095), X_CX, wrong.get(f, Camera()), rng)
            for f, side, X_CX in (("left", 1.0, hand.X_CL), ("right", -1.0, hand.X_CR))
        }

    def no_contact(self, stamp: float) -> dict[str, TactileImages]:
        """Before the grasp only."""
        return {f: b.images(stamp) for f, b in self.bubbles.items()}

    def render(self, X_CT: Array, stamp: float) -> dict[str, TactileImages]:
        """Images (by finger) of the tool at X_CT (4, 4) at a time [s]."""
        for bubble in self.bubbles.values():
            bubble.sheet.press(X_CT)
        return {f: b.images(stamp) for f, b in self.bubbles.items()}
