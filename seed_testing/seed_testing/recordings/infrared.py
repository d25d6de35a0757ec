# SPDX-License-Identifier: Apache-2.0
"""Real infrared images under known motions: what no renderer can flatter.

A recorded image is turned and shifted by a B-spline warp (cubic convolution would inflate the truth), given a flat
piece of membrane in contact as depth, and followed by the whole estimator with one finger.
"""

import json
from collections.abc import Sequence
from math import cos, radians, sin
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from seed_core.hand import Hand
from seed_core.spatial import Array, so3_log
from seed_estimation import Estimator, EstimatorParameters, PinholeCamera, TactileImages
from seed_estimation.images.tactile_images import Image
from seed_testing.recordings.npz import read_arrays

REST, PRESSED = 0.091, 0.085  # [m] depth of the membrane's apex, and of the patch
FALL = 0.003  # [m] by which the membrane at rest is nearer at the image's corners: a bubble is a dome
RADIUS = 42.0  # [px] of the patch
PERIOD = 1.0 / 45.0  # [s]
MAX_BYTES = 200_000_000


class Motion(NamedTuple):
    """Of the image about its patch's centre: turn [deg], shift [px] to the right and down."""

    turn: float = 0.0
    right: float = 0.0
    down: float = 0.0


class WarpedImage:
    """One recorded infrared image as a flat patch that can be turned and shifted."""

    def __init__(self, ir: Image, K: Array, brightness: float = 0.0, spot: bool = False, seed: int = 0) -> None:
        """brightness: share by which the patch brightens once it moves; spot: a reflection."""
        self.camera = PinholeCamera(ir.shape[1], ir.shape[0], K)
        self._spline = spline_filter(ir.astype(float), order=3)
        self._v, self._u = np.mgrid[: ir.shape[0], : ir.shape[1]].astype(float)
        self.centre = np.array((0.45 * ir.shape[1], 0.5 * ir.shape[0]))
        self._brightness, self._spot = brightness, spot
        du, dv = self._u / ir.shape[1] - 0.5, self._v / ir.shape[0] - 0.5
        self._rest = REST - FALL * 2.0 * (du * du + dv * dv)  # (H, W) [m] of the membrane that touches nothing
        self._rng = np.random.default_rng(seed)

    def render(self, motion: Motion, stamp: float, contact: bool = True) -> TactileImages:
        """The image after the motion, with a camera's noise."""
        c, s = cos(radians(motion.turn)), sin(radians(motion.turn))
        du, dv = self._u - self.centre[0] - motion.right, self._v - self.centre[1] - motion.down
        u, v = c * du + s * dv, -s * du + c * dv
        ir = map_coordinates(
            self._spline, (v + self.centre[1], u + self.centre[0]), order=3, mode="mirror", prefilter=False
        )
        inside = u * u + v * v < RADIUS**2
        if motion != Motion():
            ir = ir * (1.0 + self._brightness * np.exp(-(u * u + v * v) / (2.0 * (0.8 * RADIUS) ** 2)))
            if self._spot:
                ir += 1500.0 * np.exp(
                    -((self._u - self.centre[0] - 12) ** 2 + (self._v - self.centre[1] + 9) ** 2) / 18.0
                )
        ir += self._rng.normal(0.0, 0.01, ir.shape) * ir
        depth = np.where(inside & contact, PRESSED, self._rest) + self._rng.normal(0.0, 5e-4, ir.shape)
        return TactileImages(depth.astype(np.float32), ir.astype(np.float32), stamp)


def follow(image: WarpedImage, path: Sequence[Motion]) -> list[Motion]:
    """The motions that the estimator recovers along a path that starts at rest; NaN where its estimate is not valid."""
    estimator = Estimator(EstimatorParameters(), Hand(), {"left": image.camera})
    still = Motion()
    estimator.capture_reference([{"left": image.render(still, -1.0 + 0.02 * i, contact=False)} for i in range(5)])
    estimator.initialize_grasp([{"left": image.render(still, -0.5 + 0.02 * i)} for i in range(5)])
    out = []
    for i, motion in enumerate(path):
        stamp = i * PERIOD
        estimate = estimator.update({"left": image.render(motion, stamp)}, stamp)
        out.append(_in_image(estimator, image, estimate.X_CT) if estimate.valid else Motion(np.nan, np.nan, np.nan))
    return out


def _in_image(estimator: Estimator, image: WarpedImage, X_CT: Array) -> Motion:
    """A pose of the tool as motion of the left image about the patch's centre."""
    X_CL = estimator.hand.X_CL
    before = image.camera.pixel_rays(image.centre) * PRESSED
    p_C = X_CL[:3, :3] @ before + X_CL[:3, 3]
    after = image.camera.project(X_CL[:3, :3].T @ (X_CT[:3, :3] @ p_C + X_CT[:3, 3] - X_CL[:3, 3]))
    turn = float((X_CL[:3, :3].T @ so3_log(X_CT[:3, :3]))[2])
    return Motion(np.rad2deg(turn), float(after[0] - image.centre[0]), float(after[1] - image.centre[1]))


def path_to(end: Motion) -> list[Motion]:
    """From rest to a motion in steps of at most 3 degrees and 3 px, and three frames there."""
    steps = max(1, int(np.ceil(max(abs(end.turn), abs(end.right), abs(end.down)) / 3.0)))
    ramp = [Motion(*(i / steps * v for v in end)) for i in range(1, steps + 1)]
    return [*ramp, end, end, end]


def to_and_fro(turn: float, shift: float, frames: int) -> list[Motion]:
    """Many frames of turning and shifting, ending at rest; steps stay below 3 degrees and 3 px."""
    period = int(np.ceil(2.0 * np.pi * max(turn, shift) / 2.5))
    whole = -(-frames // period) * period  # ends where it began
    phase = 2.0 * np.pi * np.arange(1, whole + 1) / period
    path = [Motion(turn * sin(a), shift * sin(a), 0.5 * shift * sin(2.0 * a) / 2.0) for a in phase]
    return [*path, *([Motion()] * 3)]


TURNS = tuple(Motion(turn=sign * a) for a in (5.0, 10.0, 15.0, 20.0, 30.0) for sign in (1.0, -1.0))
SHIFTS = tuple(
    Motion(right=r * a, down=d * a) for a in (5.0, 10.0, 20.0) for r, d in ((1, 0), (-1, 0), (0, 1), (0, -1))
)


def relative_error(end: Motion, found: Motion) -> float:
    """Size of the error over the size of the motion, in its own unit."""
    if end.turn:
        return abs(found.turn - end.turn) / abs(end.turn)
    return float(np.hypot(found.right - end.right, found.down - end.down) / np.hypot(end.right, end.down))


def largest_error(image: WarpedImage, ends: Sequence[Motion]) -> float:
    """Largest relative error over motions from rest; NaN where an estimate is not valid."""
    return float(np.max([relative_error(end, follow(image, path_to(end))[-1]) for end in ends]))


def check(ir: Image, K: Array) -> dict[str, float]:
    """Largest relative errors of turns and shifts, plain and with +30 % brightness and a spot, and drift [deg]."""
    out = {}
    for name, brightness, spot in (("plain", 0.0, False), ("bright_and_spot", 0.3, True)):
        for kind, ends in (("turn", TURNS), ("shift", SHIFTS)):
            image = WarpedImage(ir, K, brightness=brightness, spot=spot)
            out[f"{kind}_{name}"] = largest_error(image, ends)
    last = follow(WarpedImage(ir, K), to_and_fro(15.0, 8.0, 1000))[-1]
    return {**out, "drift_deg": abs(last.turn)}


def load(path: Path) -> tuple[Image, Array]:
    """ir (n, H, W) float32 and K (3, 3) of an npz file.

    Raises:
        SeedError: the file is none, too large, or lacks the arrays.
    """
    problem = "no infrared images in it (ir_mono16 and K of an npz file)"
    ir, K = read_arrays(path, ("ir_mono16", "K"), "infrared images", problem, MAX_BYTES)
    return np.asarray(ir, np.float32), np.asarray(K, float)


def report(path: Path) -> bool:
    """Print one JSON object per image; whether all is within 1.5 % and 0.1 degrees. Raises SeedError as load does."""
    images, K = load(path)
    good = True
    for index, ir in enumerate(images):
        result = check(ir, K)
        good &= all(v <= (0.1 if name == "drift_deg" else 0.015) for name, v in result.items())
        print(json.dumps({"image": index, **{k: round(v, 5) for k, v in result.items()}}))
    return good
