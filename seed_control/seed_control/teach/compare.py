# SPDX-License-Identifier: Apache-2.0
"""How far what was played is from what was shown: along the path in contact, where the force is there."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from seed_control.teach.demonstration import STEP, Demonstration, TeachError
from seed_control.teach.frame import work_frame
from seed_control.teach.make import LEVEL, SHORTEST
from seed_control.teach.pieces import levels, touches
from seed_control.teach.settings import TeachSettings
from seed_core.spatial import Array, inverse_pose

SAME_PLACE = 0.001  # [m]


class Difference(NamedTuple):
    """Of a run from its demonstration.

    Attributes:
        path: distance of the paths in the surface, root mean square [m]. path_max: the largest [m].
        force: difference of the pressing forces at the same place, root mean square [N].
    """

    path: float
    path_max: float
    force: float


def difference(shown: Demonstration, played: Demonstration, settings: TeachSettings | None = None) -> Difference:
    """Of the part where both press with a force that stays. Raises TeachError: one of them never does."""
    settings = settings or TeachSettings()
    one, other = shown.even(), played.even()
    X_W, _ = work_frame(one, _touched(one, settings))
    (p, f), (q, g) = (_pressed(d, X_W, settings) for d in (one, other))
    away, off = np.concatenate((_away(q, p), _away(p, q))), g - force_at(p, f, q)
    return Difference(float(np.sqrt(np.mean(away**2))), float(away.max()), float(np.sqrt(np.mean(off**2))))


def force_at(p: Array, f: Array, q: Array) -> Array:
    """Force [N] at places q (m, 2): the mean of f (n,) over those of p (n, 2) that are next to q, within SAME_PLACE.

    A tip that stands has many samples at one place, and noise alone tells which of them is the nearest.
    """
    tree = cKDTree(p)
    nearest, _ = tree.query(q)
    near = tree.query_ball_point(q, nearest + SAME_PLACE)
    return np.array([np.mean(f[indices]) for indices in near])


def _away(points: Array, path: Array) -> Array:
    """Distance (n,) [m] of points (n, 2) from a path (m, 2) through its samples, not from the samples alone."""
    a, along = path[:-1], np.diff(path, axis=0)
    size = np.maximum(np.sum(along**2, axis=1), 1e-18)
    share = np.clip(np.sum((points[:, None] - a) * along, axis=2) / size, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points[:, None] - a - share[..., None] * along, axis=2).min(axis=1))


def _touched(d: Demonstration, settings: TeachSettings) -> list[tuple[int, int]]:
    return touches(np.linalg.norm(d.forces, axis=1), settings.touch, round(SHORTEST / STEP))


def _pressed(d: Demonstration, X_W: Array, settings: TeachSettings) -> tuple[Array, Array]:
    """Points (n, 2) [m] in the surface and pressing forces (n,) [N] where the force is there."""
    p = (inverse_pose(X_W) @ d.X_W_tip)[:, :2, 3]
    press = -(d.forces @ X_W[:3, 2])
    keep = [
        np.arange(a + level.there, a + level.end)
        for a, b in _touched(d, settings)
        for level in levels(press[a:b], settings.force, round(LEVEL / STEP))
    ]
    if not keep:
        raise TeachError("nothing was touched: there is nothing to compare")
    every = np.concatenate(keep)
    return p[every], press[every]
