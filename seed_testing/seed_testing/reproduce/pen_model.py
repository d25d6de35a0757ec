# SPDX-License-Identifier: Apache-2.0
"""What a felt-tip pen leaves on paper: width and darkness of a stroke by the force on it.

A model, not a measurement. The tip is a soft ball on a hard plane (Hertz): its contact circle has the radius
a = (3 F R / (4 E))^(1/3), and the line is as wide as the circle. Ink flows with the mean pressure under the tip and
saturates: darkness = 1 - exp(-p / p0), p = F / (pi a^2).
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import ArrayLike

from seed_core.spatial import Array

TIP_RADIUS = 0.75e-3  # R [m]: a marker with a round tip of 1.5 mm
TIP_MODULUS = 5.0e6  # E [Pa]: felt, on hard paper
INK_PRESSURE = 1.0e6  # p0 [Pa] at which the line has 63 % of full darkness


def stroke_width(force: ArrayLike) -> Array:
    """Width [m] of the line under each force [N]; zero where the pen does not press."""
    F = np.maximum(np.asarray(force, dtype=float), 0.0)
    return np.asarray(2.0 * np.cbrt(3.0 * F * TIP_RADIUS / (4.0 * TIP_MODULUS)))


def darkness(force: ArrayLike) -> Array:
    """0 (blank) to 1 (saturated) under each force [N]."""
    F = np.maximum(np.asarray(force, dtype=float), 0.0)
    width = stroke_width(F)
    area = np.where(F > 0.0, 0.25 * pi * width**2, 1.0)
    return np.asarray(1.0 - np.exp(-F / area / INK_PRESSURE))
