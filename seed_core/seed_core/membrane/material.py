# SPDX-License-Identifier: Apache-2.0
"""Motion of a membrane's material: the rigid part of how points have moved, and the smooth remainder.

What the wrench is told from is a band of the free membrane around the patch (`around`). Tool and patch slide on each
other; what is outside the band is free and elastic, and pulls at the band as the band has moved, whatever the history.

With u and v the points' x and z from their middle, in units of their root mean square distance from there, what moves
along x and z beyond the rigid motion is

    d(u, v) = c0 (u, 0) + c1 (0, v) + c2 (v, u) + (c3 u^2 + c4 u v + c5 v^2, c6 u^2 + c7 u v + c8 v^2) + rest

`MembraneMotion` carries both; seen in images or known from nodes, they are made by the same two functions.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from seed_core.estimate import DEFORMATIONS
from seed_core.spatial import Array, make_pose

BAND = 0.003, 0.010  # [m] from the patch along x and z of C: near it, and beyond where its edge may slide
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # of u and v
# Rows: coefficient of each power along x, then along z; columns: deformation
_SHAPES = np.zeros((2, len(POWERS), DEFORMATIONS))
_SHAPES[0, 1, 0] = _SHAPES[1, 2, 1] = _SHAPES[0, 2, 2] = _SHAPES[1, 1, 2] = 1.0
for _i in range(3):
    _SHAPES[0, 3 + _i, 3 + _i] = _SHAPES[1, 3 + _i, 6 + _i] = 1.0


class Patch(NamedTuple):
    """Where a patch was at the grasp: its middle (2,) along x and z of C [m], and its size, the unit of u and v [m]."""

    middle: Array
    size: float

    def powers(self, p: NDArray[np.floating], degree: int = 2) -> Array:
        """(6, N) of 1, u, v, u^2, u v, v^2 at points p (3, N) of the grasp in C; at degree 3 (10, N)."""
        u, v = (p[[0, 2]] - self.middle[:, None]) / self.size
        out = [np.ones_like(u), u, v, u * u, u * v, v * v]
        if degree == 3:
            out += [u * u * u, u * u * v, u * v * v, v * v * v]
        return np.stack(out)


def around(p: NDArray[np.floating], patch: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(N,) which points p (3, N) of the grasp in C lie in the band around the patch that points (3, M) make."""
    distance, _ = cKDTree(patch[[0, 2]].T).query(p[[0, 2]].T, distance_upper_bound=BAND[1])
    return np.asarray((distance > BAND[0]) & (distance < BAND[1]))


def patch_of(p: NDArray[np.floating]) -> Patch:
    """The patch that points p (3, N) of the grasp in C make."""
    flat = p[[0, 2]].astype(float)
    middle = flat.mean(axis=1)
    return Patch(middle, float(np.sqrt(np.square(flat - middle[:, None]).sum(axis=0).mean())))


def rigid_motion(before: ArrayLike, after: ArrayLike) -> Array:
    """X (4, 4) that takes points (3, N) from before to after with the least sum of squares (Kabsch 1976)."""
    p, q = np.asarray(before, float), np.asarray(after, float)
    a, b = p.mean(axis=1), q.mean(axis=1)
    U, _, Vt = np.linalg.svd((q - b[:, None]) @ (p - a[:, None]).T)
    R = U @ np.diag((1.0, 1.0, np.linalg.det(U @ Vt))) @ Vt
    return make_pose(R, b - R @ a)


def deformation(X: ArrayLike, before: ArrayLike, after: ArrayLike) -> Array:
    """(9,) [m] of how points (3, N) have moved from before to after beyond the rigid motion X (4, 4).

    Least squares, in which a shift and a turn beyond X, there to make up for the means of u^2 and v^2, are free.
    """
    p, X = np.asarray(before, float), np.asarray(X, float)
    beyond = (np.asarray(after, float) - X[:3, :3] @ p - X[:3, 3:])[[0, 2]]
    powers = patch_of(p).powers(p)
    field = np.linalg.lstsq(powers.T, beyond.T, rcond=None)[0].T  # (2, 6)
    return of_field(field)


def of_field(field: Array) -> Array:
    """(9,) deformation of a field (2, 6) along x and z in powers of u and v; what is a shift or a turn is left out."""
    scaled = _SHAPES.reshape(-1, DEFORMATIONS)
    return np.asarray(scaled.T @ field.ravel() / np.square(scaled).sum(axis=0))
