# SPDX-License-Identifier: Apache-2.0
"""Recorded presses of one bubble with a RealSense D405: reading them, and the contact found in them."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array
from seed_estimation import ContactPatch, PinholeCamera, TactileImages
from seed_estimation.images.tactile_images import Image
from seed_testing.recordings.npz import read_arrays

MAX_BYTES = 500_000_000
UNTOUCHED, TOUCHED, HELD = 59, 64, 72  # frames: no contact before, contact from here on, still from here on
MOST_UNSTEADY, LEAST_CORRELATION = 0.15, 0.97  # [mm] deviation of the centroid, [1] of indentation with force
_KEYS = ("t", "depth_0p1mm", "gray_320x240", "wrench_N_Nm", "intrinsics_fxfycxcy", "inv_brown_conrady")


class Press(NamedTuple):
    """A recording.

    Attributes:
        camera: with the sensor's own distortion model.
        images: depth with the grey image registered to it, one per frame.
        wrench: (N, 6) force [N] and torque [N m] as logged, not zeroed.
    """

    camera: PinholeCamera
    images: list[TactileImages]
    wrench: Array

    def force(self, still: int = 50) -> Array:
        """(N,) size of the force [N] against the mean of the first `still` frames."""
        F = self.wrench[:, :3] - self.wrench[:still, :3].mean(axis=0)
        return np.asarray(np.linalg.norm(F, axis=1))


def load(path: Path) -> Press:
    """A press from an npz file.

    Raises:
        SeedError: the file is none, too large, or lacks an array.
    """
    stamps, depths, greys, wrench, intrinsics, distortion = read_arrays(
        path, _KEYS, "a press", f"not a recorded press (needs {', '.join(_KEYS)})", MAX_BYTES
    )
    fx, fy, cx, cy = (float(v) for v in intrinsics)
    h, w = depths.shape[1:]
    K = np.array(((fx, 0, cx), (0, fy, cy), (0, 0, 1.0)))
    camera = PinholeCamera(w, h, K, np.asarray(distortion, float), "inverse_brown_conrady")
    images = [
        TactileImages(metres(depth), registered(grey, (h, w)), float(t))
        for depth, grey, t in zip(depths, greys, stamps, strict=True)
    ]
    return Press(camera, images, np.asarray(wrench, float))


def metres(depth: NDArray[np.uint16]) -> Image:
    """Depth (H, W) [m] from tenths of millimetres; NaN for 0."""
    return np.where(depth > 0, depth * np.float32(1e-4), np.float32(np.nan)).astype(np.float32)


def registered(grey: NDArray[np.uint8], shape: tuple[int, int]) -> Image:
    """A smaller grey image on depth's pixels (H, W): pixel (u, v) lies at depth pixel (s u + (s - 1)/2, ...)."""
    return np.asarray(cv2.resize(grey, shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)


class Findings(NamedTuple):
    """What the patches of a press say. Frames are counted from 0; `contact_from` is None without lasting contact."""

    frames: int
    false_contacts: int
    contact_from: int | None
    centroid_std_mm: float
    correlation: float

    @property
    def good(self) -> bool:
        """Within what the recording is known to show."""
        in_time = self.contact_from is not None and self.contact_from <= TOUCHED
        steady = self.centroid_std_mm <= MOST_UNSTEADY and self.correlation > LEAST_CORRELATION
        return self.false_contacts == 0 and in_time and steady


def findings(found: Sequence[ContactPatch], force: Array) -> Findings:
    """Judges one patch per frame against the measured force (N,) [N]."""
    contact = [p.in_contact for p in found]
    free = [i for i, c in enumerate(contact) if not c]
    contact_from = (max(free) + 1 if free else 0) if contact[-1] else None
    centroid = np.array([p.centroid for p in found[HELD:]])
    indentation = [p.mean_indentation for p in found]
    return Findings(
        frames=len(found),
        false_contacts=sum(contact[:UNTOUCHED]),
        contact_from=contact_from,
        centroid_std_mm=1e3 * float(np.std(centroid, axis=0).max()),
        correlation=float(np.corrcoef(indentation, force)[0, 1]),
    )
