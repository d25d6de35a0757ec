# SPDX-License-Identifier: Apache-2.0
"""From the colour of a gel's coat to its slopes, calibrated by pressing a ball into it.

The logarithm of colour over that of the free gel, channel by channel, r = log((I + o)/(I_0 + o)), takes exposure, gamma
and uneven light out as far as they are factors. Slopes (du/dx, du/dy) are a polynomial in r without a constant, so that
the free gel is flat, whose coefficients are polynomials in the place, because near lamps shine differently everywhere.

A ball of radius R that is pressed in about c has slopes -(s - c)/sqrt(R^2 - |s - c|^2) where it touches. Its middle is
found in turns with the coefficients: first from where colours change, then from where the slopes vanish.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Array32, Image, Mask

OFFSET = 4.0  # [counts]: dark pixels tell little
ORDER, PLACE_ORDER = 3, 2  # of the polynomials in colour and in the place
FIRM = 1e-4  # ridge on the coefficients, per sample: times ten for each degree more
FEW = 30  # [px] of an imprint tell nothing
LEAST = 8  # imprints that must be seen whole
ROUNDS, WHOLE_ROUNDS = 6, 3  # imprints at the edge of the view come in when the map is known roughly
CHANGED = 0.05  # of the logarithm, by which a colour has changed
PRESSED = 0.45  # of its radius by which a ball is pressed in: so much nearer, it is seen larger
WITHIN = 0.42  # share of the ball's radius within which it touches the gel, pressed in by 0.4 of it
STEEPEST = np.float32(0.9)  # slope beyond which colours tell nothing that a ball has calibrated
_POWERS = [
    (i, j, k) for n in range(1, ORDER + 1) for i in range(n, -1, -1) for j in range(n - i, -1, -1) for k in (n - i - j,)
]
_PLACES = [(i, j) for i in range(PLACE_ORDER + 1) for j in range(PLACE_ORDER + 1 - i)]
SHAPE = len(_POWERS), len(_PLACES), 2  # of the coefficients; the last are the slopes along x and y

_STIFF = np.array([10.0 ** (sum(power) + sum(place) - 1) for power in _POWERS for place in _PLACES])


class Canvas:
    """The pixels on which slopes are computed: every n-th of a camera's.

    Attributes:
        n: pixels per side that are averaged. shape: (h, w).
        place: (2, h, w) [m] x and y of the free gel.
        pitch: two (h, w) [m] from a pixel to the next, along x and along y.
    """

    def __init__(self, camera: PinholeCamera, distance: float, n: int) -> None:
        self.camera, self.n, self.distance = camera, n, distance
        h, w = camera.height // n, camera.width // n
        self.shape = h - h % 2, w - w % 2  # the cosine transform wants even sides
        v, u = np.mgrid[: self.shape[0], : self.shape[1]].astype(float) * n + 0.5 * (n - 1)
        rays = camera.pixel_rays(np.stack((u, v), axis=-1))
        self.place: Array32 = np.ascontiguousarray(np.moveaxis(rays[..., :2], -1, 0) * distance, np.float32)
        self.pitch = np.gradient(self.place[0], axis=1), np.gradient(self.place[1], axis=0)
        reach = np.float32(np.abs(self.place).max())
        self.powers = np.stack([(self.place[0] / reach) ** i * (self.place[1] / reach) ** j for i, j in _PLACES])

    def small(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """An image (H, W[, 3]) at this size."""
        h, w = self.shape
        return np.asarray(cv2.resize(image[: h * self.n, : w * self.n], (w, h), interpolation=cv2.INTER_AREA), np.uint8)

    def pixels(self, x: Array32, y: Array32) -> tuple[Array32, Array32]:
        """Column and row of this canvas that see directions (x, y) = (X/Z, Y/Z) of the optical frame."""
        full = self.camera.project32(np.stack((x, y, np.ones_like(x))))
        return (full[0] - np.float32(0.5 * (self.n - 1))) / self.n, (full[1] - np.float32(0.5 * (self.n - 1))) / self.n


def filled(image: Array32, hole: Mask, sigma: float) -> Array32:
    """An image (h, w[, c]) whose pixels where hole is 1 are replaced by a Gaussian average [px] of those around."""
    keep = (1 - hole).astype(np.float32)
    weight = np.maximum(cv2.GaussianBlur(keep, (0, 0), sigma), np.float32(1e-3))
    masked = image * (keep if image.ndim == 2 else keep[..., None])
    around = cv2.GaussianBlur(masked, (0, 0), sigma)
    there = hole > 0
    out = image.copy()
    out[there] = around[there] / (weight[there] if image.ndim == 2 else weight[there][:, None])
    return out


def mean_colour(images: Sequence[NDArray[np.uint8]]) -> Array32:
    """(H, W, 3) [counts] over images of the same."""
    return np.asarray(np.mean(images, axis=0, dtype=np.float32), np.float32)


def change(rgb: Array32, free: Array32) -> Array32:
    """r (3, h, w) of colours (h, w, 3) against those of the free gel [counts]."""
    r = cv2.log((rgb + np.float32(OFFSET)) / (free + np.float32(OFFSET)))
    return np.ascontiguousarray(np.moveaxis(r, -1, 0))


@dataclass(frozen=True, eq=False)
class Shading:
    """Coefficients (powers of colour, powers of place, 2) of one gel, of shape SHAPE."""

    coefficients: Array

    def slopes(self, r: Array32, maps: Array32) -> tuple[Image, Image]:
        """du/dx and du/dy (h, w) from r (3, h, w) and `maps` of the canvas."""
        gx, gy = np.zeros_like(r[0]), np.zeros_like(r[0])
        for monomial, (cx, cy) in zip(_monomials(r), maps, strict=True):
            gx += monomial * cx
            gy += monomial * cy
        return np.clip(gx, -STEEPEST, STEEPEST), np.clip(gy, -STEEPEST, STEEPEST)

    def maps(self, canvas: Canvas) -> Array32:
        """(powers of colour, 2, h, w) the coefficients at each pixel."""
        return np.ascontiguousarray(np.einsum("kpc,phw->kchw", self.coefficients, canvas.powers), np.float32)


def _monomials(r: Array32) -> list[Array32]:
    """Each (h, w), in the order of _POWERS; a product takes the ones before it."""
    known: dict[tuple[int, int, int], Array32] = {}
    for i, j, k in _POWERS:
        axis = 0 if i else 1 if j else 2
        rest = (i - (axis == 0), j - (axis == 1), k - (axis == 2))
        known[i, j, k] = r[axis] if sum(rest) == 0 else r[axis] * known[rest]
    return [known[power] for power in _POWERS]


@dataclass(frozen=True, eq=False)
class Press:
    """A ball in the gel: change of colour (3, h, w), and where a dot hides it (h, w)."""

    r: Array32
    hidden: Mask


def fit_shading(presses: Sequence[Press], canvas: Canvas, radius: float) -> Shading:
    """Coefficients from presses of a ball of known radius [m], all over the gel.

    Raises:
        SeedError: fewer than eight presses that show an imprint, or a radius of no such ball.
    """
    if not 0.0 < radius < canvas.distance:
        raise SeedError(
            f"radius {radius:g} m of the ball must lie between 0 and {canvas.distance:g} m: is it in metres?"
        )
    imprints = [(press, *imprint) for press in presses if (imprint := _imprint(press, canvas)) is not None]
    whole = sum(is_whole for _, _, is_whole in imprints)
    if whole < LEAST:
        raise SeedError(
            f"{whole} of {len(presses)} images show the whole imprint of a ball; press it in at {LEAST} places or "
            "more, all over the gel, and some at the edge of the view besides"
        )
    within, nearer = WITHIN * radius, np.float32(1.0 - PRESSED * radius / canvas.distance)
    shading: Shading | None = None
    middles = [middle for _, middle, _ in imprints]
    for turn in range(ROUNDS):
        if shading is not None:
            maps = shading.maps(canvas)
            middles = [
                _middle(press, maps, shading, canvas, middle, (within, nearer), radius)
                for (press, _, _), middle in zip(imprints, middles, strict=True)
            ]
        A, b = [], []
        for (press, _, is_whole), middle in zip(imprints, middles, strict=True):
            if not is_whole and turn < WHOLE_ROUNDS:
                continue
            off = (canvas.place - np.asarray(middle, np.float32)[:, None, None]) * nearer
            square = (off * off).sum(0)
            inside = (square < within**2) & (press.hidden == 0)
            if np.count_nonzero(inside) < FEW:  # its middle is out of view
                continue
            slope = -off[:, inside] / np.sqrt(radius**2 - square[inside])
            terms = np.stack([m[inside] for m in _monomials(press.r)])
            powers = canvas.powers[:, inside]
            A.append((terms[:, None] * powers[None]).reshape(-1, terms.shape[1]).T)
            b.append(slope.T)
        if not A:
            raise SeedError(f"no imprint is as large as that of a ball of {radius:g} m radius: is it in metres?")
        M, y = np.concatenate(A).astype(float), np.concatenate(b).astype(float)
        scale = np.sqrt((M * M).mean(0)) + 1e-12
        M /= scale
        c = np.linalg.solve(M.T @ M + FIRM * len(M) * np.diag(_STIFF), M.T @ y) / scale[:, None]
        shading = Shading(c.reshape(len(_POWERS), len(_PLACES), 2))
    assert shading is not None
    return shading


def _imprint(press: Press, canvas: Canvas) -> tuple[Array, bool] | None:
    """Middle (2,) [m] of the disc where colours have changed, and whether all of it is in view; None without one."""
    strength = np.sqrt((press.r**2).sum(0))
    strength[press.hidden > 0] = 0.0
    strength = cv2.GaussianBlur(strength, (0, 0), 1.5)
    count, labels, stats, _ = cv2.connectedComponentsWithStats((strength > CHANGED).astype(np.uint8))
    if count < 2:
        return None
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    u0, v0, w, h = stats[largest, :4]
    if min(w, h) < 8:
        return None
    whole = u0 > 0 and v0 > 0 and u0 + w < canvas.shape[1] and v0 + h < canvas.shape[0]
    inside = cv2.morphologyEx((labels == largest).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)) > 0
    x, y = canvas.place[0][inside], canvas.place[1][inside]
    return np.array((x.mean(), y.mean()), float), whole


def _middle(
    press: Press,
    maps: Array32,
    shading: Shading,
    canvas: Canvas,
    middle: Array,
    where: tuple[float, np.float32],
    radius: float,
) -> Array:
    """Where the slopes of a ball vanish: the middle (2,) that they agree with best."""
    within, nearer = where
    off = (canvas.place - np.asarray(middle, np.float32)[:, None, None]) * nearer
    square = (off * off).sum(0)
    inside = (square < within**2) & (press.hidden == 0)
    gx, gy = shading.slopes(press.r, maps)
    root = np.sqrt(radius**2 - square[inside])
    errors = np.stack((gx[inside] * root + off[0][inside], gy[inside] * root + off[1][inside]))
    if not inside.any():
        return middle
    return np.asarray(middle + np.clip(np.median(errors, axis=1), -within, within))
