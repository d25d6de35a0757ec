# SPDX-License-Identifier: Apache-2.0
"""Arrows for force and torque, and the ellipsoid of what is not known of them; always the same faces, so only the
vertices change from picture to picture."""

import numpy as np
from numpy.typing import ArrayLike

from seed_core.meshes.shapes import Mesh, direction, loft, sphere, turned
from seed_core.spatial import Array, make_pose

FORCE_SCALE = 0.008  # [m/N] length of an arrow: 10 N are 80 mm
TORQUE_SCALE = 0.05  # [m/(N m)] radius of a turning arrow above its least
_LEAST = 1e-4  # [m]; a shorter arrow is a point
_HEAD = 3.0  # radius and length of a head in radii of the shaft: 3 and 2 * 3
_ARC = 1.5 * np.pi  # [rad] of a turning arrow


def arrow(start: ArrayLike, vector: ArrayLike, scale: float = FORCE_SCALE, radius: float = 0.004) -> Mesh:
    """From start (3,) [m] along vector (3,) [N], scale [m/N] long; a point where the vector is zero."""
    v = scale * np.asarray(vector, float)
    length = float(np.linalg.norm(v))
    if length < _LEAST:
        return Mesh(*_straight(_LEAST, _LEAST)).moved(make_pose(None, start))
    return _straight(length, radius).moved(make_pose(direction(v), start))


def _straight(length: float, radius: float) -> Mesh:
    head = min(2.0 * _HEAD * radius, 0.6 * length)
    neck = length - head
    profile = [(radius, 0.0), (radius, neck), (_HEAD * radius, neck), (1e-2 * radius, length)]
    return turned(profile, 16)


def turning_arrow(centre: ArrayLike, vector: ArrayLike, scale: float = TORQUE_SCALE, radius: float = 0.003) -> Mesh:
    """Three quarters of a ring about vector (3,) [N m] by the right-hand rule; larger and thicker with its size."""
    size = float(np.linalg.norm(vector))
    grown = min(size / 0.3, 1.0)  # thin below 0.3 N m, a point at none
    ring, thick = (0.03 + scale * size) * grown + _LEAST, radius * grown + 0.01 * _LEAST
    head = min(2.0 * _HEAD * thick / ring, 0.5 * _ARC)  # [rad]
    angle = np.linspace(0.0, _ARC - head, 25)
    angles = np.concatenate([angle, [angle[-1], _ARC]])
    radii = np.concatenate([np.full(len(angle), thick), [_HEAD * thick, 1e-2 * thick]])
    turn = np.linspace(0.0, -2.0 * np.pi, 12, endpoint=False)  # the way that its own rings face along the arc
    out = ring + radii[:, None] * np.cos(turn)
    rings = np.stack(
        [
            np.cos(angles)[:, None] * out,
            np.sin(angles)[:, None] * out,
            radii[:, None] * np.sin(turn) + np.zeros_like(out),
        ],
        axis=-1,
    )
    along = vector if size > 0.0 else (0.0, 0.0, 1.0)
    return loft(rings).moved(make_pose(direction(along), centre))


def ellipsoid(centre: ArrayLike, covariance: Array, scale: float = FORCE_SCALE, deviations: float = 2.0) -> Mesh:
    """Where the tip of an arrow at centre (3,) [m] may lie: `deviations` of a covariance (3, 3) [N^2]."""
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    unit = sphere(1.0, sectors=16)
    radii = np.maximum(scale * deviations * np.sqrt(np.maximum(values, 0.0)), _LEAST)
    return Mesh(unit.vertices * radii @ axes.T + np.asarray(centre, float), unit.faces)
