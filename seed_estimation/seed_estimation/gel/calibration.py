# SPDX-License-Identifier: Apache-2.0
"""The shading of a gel from images: free, and with a ball pressed in at eight places or more."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from seed_core.errors import SeedError
from seed_core.program.npz import read_npz, write_npz
from seed_estimation.gel.dots import DotFinder
from seed_estimation.gel.image import GelImage
from seed_estimation.gel.settings import GelSettings
from seed_estimation.gel.shading import SHAPE, Canvas, Press, Shading, change, filled, fit_shading, mean_colour
from seed_estimation.images.camera import PinholeCamera


def calibrated(
    free: Sequence[GelImage], presses: Sequence[GelImage], radius: float, camera: PinholeCamera, p: GelSettings
) -> Shading:
    """The shading of one gel.

    Args:
        free: nothing touches. presses: one ball of that radius [m] in each, away from the edge, at different places.

    Raises:
        SeedError: no image of the free gel, an image of another size than the camera's, or too few presses show an
            imprint.
    """
    if not free:
        raise SeedError("no image of the free gel: take some with nothing touching it")
    for image in (*free, *presses):
        if image.rgb.shape[:2] != camera.shape:
            raise SeedError(f"an image has shape {image.rgb.shape[:2]}; the camera's calibration says {camera.shape}")
    canvas = Canvas(camera, p.distance, p.decimate)
    per_metre = float(camera.K[0, 0]) / p.distance
    finder, (h, w), n = DotFinder(p.dot * per_metre, p.contrast), canvas.shape, p.decimate
    mean = mean_colour([i.rgb for i in free])
    _, hidden = finder.find(np.rint(mean).astype(np.uint8))
    full = filled(mean, hidden, 0.8 * p.dot * per_metre)
    rest = cv2.resize(full[: h * n, : w * n], (w, h), interpolation=cv2.INTER_AREA)
    seen = []
    for image in presses:
        _, hidden = finder.find(image.rgb)
        hides = cv2.resize(hidden[: h * n, : w * n] * 255, (w, h), interpolation=cv2.INTER_AREA) > 0
        seen.append(Press(change(canvas.small(image.rgb).astype(np.float32), rest), np.asarray(hides, np.uint8)))
    return fit_shading(seen, canvas, radius)


def save(file: Path, shadings: dict[str, Shading]) -> None:
    """Shadings by finger, as an npz file, whole or not at all. Raises OSError."""
    arrays: dict[str, Any] = {finger: shading.coefficients for finger, shading in shadings.items()}
    write_npz(file, arrays)


def load(file: Path) -> dict[str, Shading]:
    """Shadings by finger. Raises SeedError: no such file, or none of ours."""
    problem = "no calibration of gels"
    out = {}
    for finger, values in read_npz(file, problem).items():
        if values.shape != SHAPE or values.dtype.kind != "f" or not np.isfinite(values).all():
            raise SeedError(
                f"{file}: {problem}: coefficients of '{finger}' are {values.dtype} of shape {values.shape}; finite "
                f"numbers of shape {SHAPE} are needed: calibrate again"
            )
        out[finger] = Shading(values)
    if not out:
        raise SeedError(f"{file}: {problem}: it is empty")
    return out
