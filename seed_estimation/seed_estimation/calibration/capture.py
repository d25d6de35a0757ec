# SPDX-License-Identifier: Apache-2.0
"""A capture for the calibration, step by step: each is judged by what `calibrate` will make of it."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from seed_core.errors import FailedError, SeedError
from seed_core.hand import Hand
from seed_core.program.npz import write_npz
from seed_core.spatial import Array
from seed_estimation.calibration.calibrate import FAR, LEAST_TURN, NEAR, PARAMETERS, MembraneShape, at_rest
from seed_estimation.calibration.cylinder import Line, seen_axis
from seed_estimation.contact.membrane import Membrane, mean_depth
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Image, TactileImages

LEAST_COVERAGE = 0.2  # share of the image that must show the membrane, as in `calibrate`
MOST_FULL = 0.02  # share of pixels that may be full, above which dots and specular spots drown
MOST_NOISE = 1.5e-3  # [m] median deviation of a pixel over time; a PicoFlexx has 0.5 mm
MOST_DRIFT = 0.4e-3  # [m] between the first and the second half of the images: somebody touches or moves it
BOX, HALF = 9, 0.5  # [px] side of the boxes; share of a box that must have depth
LEAST_POSES, MOST_POSES = 3, 5

Frames = Sequence[Mapping[str, TactileImages]]  # images of both fingers, one after the other


class Look(NamedTuple):
    """What a few images of one finger show.

    Attributes:
        coverage: share of the image with depth where a membrane may be.
        noise: median deviation of a pixel over time [m].
        drift: from the first half of the images to the second, that a tenth of the pixels exceed [m].
        full: share of the brightness's pixels that are full.
        bright: median brightness [counts].
    """

    coverage: float
    noise: float
    drift: float
    full: float
    bright: float

    def __str__(self) -> str:
        return (
            f"coverage {self.coverage:.0%}, noise {1e3 * self.noise:.2f} mm, drift {1e3 * self.drift:.2f} mm, "
            f"full pixels {self.full:.1%}"
        )

    def problem(self) -> str:
        """Why these images are of no use, or ''."""
        if self.coverage < LEAST_COVERAGE:
            return (
                f"only {self.coverage:.0%} of the image has depth between {NEAR:g} and {FAR:g} m (at least "
                f"{LEAST_COVERAGE:.0%}): is the camera's lens clean, and is the bubble inflated?"
            )
        if self.noise > MOST_NOISE:
            return f"depth varies by {1e3 * self.noise:.2f} mm (at most {1e3 * MOST_NOISE:g} mm): keep all of it still"
        if self.drift > MOST_DRIFT:
            return (
                f"depth moved by {1e3 * self.drift:.2f} mm meanwhile (at most {1e3 * MOST_DRIFT:g} mm): keep the hand "
                "and what it holds still, and let the bubble's pressure settle"
            )
        if self.full > MOST_FULL:
            return f"{self.full:.0%} of the pixels are full (at most {MOST_FULL:.0%}): a shorter exposure is needed"
        if self.bright <= 0.0:
            return "the picture is black: is the light inside the bubble on?"
        return ""


def look_at(images: Sequence[TactileImages], full: float) -> Look:
    """What images of one finger show; full: value of a full pixel [counts]."""
    depth = [i.depth[::2, ::2] for i in images]
    mean, deviation = mean_depth(depth, NEAR, FAR)
    half = len(depth) // 2
    moved = mean_depth(depth[:half], NEAR, FAR)[0] - mean_depth(depth[half:], NEAR, FAR)[0] if half else mean * 0.0
    ir = images[-1].ir
    return Look(
        float(np.isfinite(mean).mean()),
        _median(deviation[np.isfinite(mean)]),
        _drift(moved),
        float(np.mean(ir >= full)),
        float(np.median(ir)),
    )


def _drift(moved: Image) -> float:
    """That a tenth of the pixels exceed [m], of changes (H, W) [m], averaged over boxes for noise's sake."""
    known = np.isfinite(moved).astype(np.float32)
    share = cv2.blur(known, (BOX, BOX))
    mean = cv2.blur(np.nan_to_num(moved), (BOX, BOX)) / np.maximum(share, 1e-6)
    values = np.abs(mean[share > HALF])
    return float(np.percentile(values, 90.0)) if values.size else 0.0


def _median(values: Image) -> float:
    return float(np.median(values)) if values.size else 0.0


class Capture:
    """`free`, then `pose` three to five times, then `save`.

    Attributes:
        poses: cylinders taken so far.
    """

    def __init__(
        self, cameras: Mapping[str, PinholeCamera], hand: Hand, shape: MembraneShape, radius: float, full: float
    ) -> None:
        """A capture of cameras by finger, whose membranes and cylinder are as told; full: of a full pixel [counts]."""
        self._cameras, self._shape, self._radius, self._full = cameras, shape, radius, full
        self._X: dict[str, Array] = {"left": hand.X_CL, "right": hand.X_CR}
        self._free: dict[str, list[Image]] = {}
        self._rest: dict[str, tuple[Image, Membrane]] = {}
        self._held: list[dict[str, Image]] = []
        self._axes: list[dict[str, Line]] = []

    @property
    def poses(self) -> int:
        """Cylinders taken so far."""
        return len(self._held)

    def look(self, frames: Frames) -> dict[str, Look]:
        """What images show, by finger; at least two."""
        return {f: look_at([frame[f] for frame in frames], self._full) for f in self._cameras}

    def free(self, frames: Frames) -> str:
        """Take images of membranes that touch nothing; what they show. Raises FailedError: of no use."""
        words = self._judged(frames)
        for finger, camera in self._cameras.items():
            images = [frame[finger].depth for frame in frames]
            with _naming(finger):
                self._rest[finger] = at_rest(finger, camera, self._X[finger], images, self._shape)
            self._free[finger] = images
        return words

    def pose(self, frames: Frames) -> str:
        """Take images of the cylinder at rest in another pose; what they show. Raises FailedError: of no use."""
        words = self._judged(frames)
        mean = {f: mean_depth([frame[f].depth for frame in frames], NEAR, FAR)[0] for f in self._cameras}
        axes = {}
        for finger in self._cameras:
            with _naming(finger):
                axes[finger] = self._axis(finger, mean[finger])
        turns = [max(axes[f].angle(other[f]) for f in axes) for other in self._axes]
        if turns and min(turns) < LEAST_TURN:
            k = int(np.argmin(turns)) + 1
            raise FailedError(
                f"the cylinder lies as in pose {k}, within {np.rad2deg(min(turns)):.1f} degrees (at least "
                f"{np.rad2deg(LEAST_TURN):.0f}): tilt it by 10 to 20 degrees against the other poses"
            )
        self._held.append(mean)
        self._axes.append(axes)
        return words + (f"; {np.rad2deg(min(turns)):.0f} degrees from the nearest other pose" if turns else "")

    def _axis(self, finger: str, depth: Image) -> Line:
        offset, membrane = self._rest[finger]
        return seen_axis(membrane, depth + offset, self._radius, PARAMETERS).moved(self._X[finger])

    def _judged(self, frames: Frames) -> str:
        looks = self.look(frames)
        for finger, look in looks.items():
            if problem := look.problem():
                raise FailedError(f"{finger}: {problem}")
        return "; ".join(f"{finger}: {look}" for finger, look in looks.items())

    def save(self, path: Path) -> None:
        """Write what `calibrate` reads, whole or not at all. Raises OSError."""
        arrays: dict[str, object] = {}
        for finger, camera in self._cameras.items():
            arrays |= {f"{finger}_K": camera.K, f"{finger}_D": camera.D, f"{finger}_model": camera.model}
            arrays[f"{finger}_no_contact"] = np.stack(self._free[finger])
            if self._held:
                arrays[f"{finger}_grasped"] = np.stack([mean[finger] for mean in self._held])
        write_npz(path, arrays)


@contextmanager
def _naming(finger: str) -> Iterator[None]:
    """Refusals get the finger's name."""
    try:
        yield
    except SeedError as error:
        raise FailedError(f"{finger}: {str(error).removeprefix(f'{finger}: ')}") from error
