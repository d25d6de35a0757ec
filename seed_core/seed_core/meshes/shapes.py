# SPDX-License-Identifier: Apache-2.0
"""Closed triangle meshes of simple bodies. Faces are counter-clockwise seen from outside."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seed_core.spatial import Array, make_pose

SECTORS = 32  # of round bodies
Colour = tuple[int, int, int]  # red, green, blue, 0 to 255
Faces = NDArray[Any]


class Mesh(NamedTuple):
    """Vertices (n, 3) [m] and faces (m, 3) of their indices (int32)."""

    vertices: Array
    faces: Faces

    def moved(self, X: Array) -> "Mesh":
        """The same at the pose X (4, 4)."""
        return Mesh(self.vertices @ X[:3, :3].T + X[:3, 3], self.faces)


class Part(NamedTuple):
    """A mesh to draw, fixed in a frame: a letter of the notation (W, E, C, T), or the number of an arm's frame."""

    name: str
    frame: str | int
    mesh: Mesh
    colour: Colour
    opacity: float = 1.0


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """All of them as one mesh."""
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = [m.faces + start for m, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces).astype(np.int32))


def loft(rings: ArrayLike) -> Mesh:
    """Skin over rings (k, n, 3) [m] of n points each, with flat ends.

    The rings run counter-clockwise seen from the last one.
    """
    points = np.asarray(rings, float)
    k, n = points.shape[:2]
    ends = points[[0, -1]].mean(axis=1)
    return Mesh(np.concatenate([points.reshape(-1, 3), ends]), _loft_faces(k, n))


def _loft_faces(k: int, n: int) -> Faces:
    i = np.arange(n)
    j = (i + 1) % n
    sides = [f for a in range(0, (k - 1) * n, n) for f in ((a + i, a + j, a + n + j), (a + i, a + n + j, a + n + i))]
    last, bottom = (k - 1) * n, np.full(n, k * n)
    faces = [*sides, (bottom, j, i), (bottom + 1, last + i, last + j)]
    return np.concatenate([np.column_stack(f) for f in faces]).astype(np.int32)


def turned(profile: Sequence[tuple[float, float]], sectors: int = SECTORS) -> Mesh:
    """Body of revolution about z: profile of (radius, z) [m], from the lowest to the highest z."""
    angle = 2.0 * np.pi * np.arange(sectors) / sectors
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(sectors)])
    return loft([r * circle + (0.0, 0.0, z) for r, z in profile])


def cylinder(radius: float, start: ArrayLike, end: ArrayLike, sectors: int = SECTORS) -> Mesh:
    """Between the centres of its ends, (3,) [m]."""
    return _between(turned([(radius, 0.0), (radius, _distance(start, end))], sectors), start, end)


def capsule(radius: float, start: ArrayLike, end: ArrayLike, sectors: int = SECTORS) -> Mesh:
    """All within radius [m] of the segment from start to end, (3,) [m]."""
    angle = np.linspace(-0.5 * np.pi, 0.0, 7)[1:]
    length = _distance(start, end)
    low = [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angle]
    bottom, top = (1e-3 * radius, -radius), (1e-3 * radius, length + radius)
    return _between(turned([bottom, *low, *((r, length - z) for r, z in reversed(low)), top], sectors), start, end)


def sphere(radius: float, centre: ArrayLike = (0.0, 0.0, 0.0), sectors: int = 20) -> Mesh:
    """Of radius [m] about centre (3,) [m]."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, sectors // 2 + 1)[1:-1]
    profile = [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angle]
    pole = 1e-3 * radius
    mesh = turned([(pole, -radius), *profile, (pole, radius)], sectors)
    return Mesh(mesh.vertices + np.asarray(centre, float), mesh.faces)


def box(size: ArrayLike, centre: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Of edges size (3,) [m] along the axes about centre (3,) [m]."""
    corner = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    rings = [np.column_stack([corner, np.full(4, z)]) for z in (-1.0, 1.0)]
    mesh = loft(rings)
    return Mesh(0.5 * mesh.vertices * np.asarray(size, float) + np.asarray(centre, float), mesh.faces)


def slab(size: tuple[float, float], thickness: float, centre: tuple[float, float] = (0.0, 0.0)) -> Mesh:
    """A plate whose upper side is z = 0 [m]: a table in the frame S of its surface, tilted by the pose X_WS."""
    return box((*size, thickness), (*centre, -0.5 * thickness))


def hills(x: ArrayLike, y: ArrayLike, z: ArrayLike, thickness: float) -> Mesh:
    """A plate whose upper side passes through heights z (n, m) [m] over x (n,) and y (m,); its lower side is flat."""
    heights = np.asarray(z, float)
    u, v = np.meshgrid(np.asarray(x, float), np.asarray(y, float), indexing="ij")
    n, m = heights.shape
    low = np.full_like(heights, heights.min() - thickness)
    vertices = np.concatenate([np.stack([u, v, h], axis=-1).reshape(-1, 3) for h in (heights, low)])
    at = np.arange(n * m).reshape(n, m)
    a, b, c, d = (g.ravel() for g in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    top = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    rim = np.concatenate([at[:, 0], at[-1, 1:], at[-2::-1, -1], at[0, -2:0:-1]])  # counter-clockwise from above
    after, below = np.roll(rim, -1), n * m
    sides = [np.column_stack([rim, rim + below, after]), np.column_stack([after, rim + below, after + below])]
    return Mesh(vertices, np.concatenate([top, top[:, ::-1] + below, *sides]).astype(np.int32))


def tube(points: ArrayLike, radius: float, sectors: int = 8) -> Mesh:
    """Along a polyline (n, 3) [m], n at least 2: a path to draw."""
    line = np.asarray(points, float)
    step = np.gradient(line, axis=0)
    length = np.linalg.norm(step, axis=1)
    keep = length > 1e-9
    if keep.sum() < 2:  # it stands still: a bead
        return sphere(radius, line[0], 2 * sectors)
    line, along = line[keep], step[keep] / length[keep, None]
    helper = np.array((0.0, 0.0, 1.0)) if np.abs(along[:, 2]).max() < 0.95 else np.array((0.36, 0.8, 0.48))
    across = np.cross(along, helper)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
    up = np.cross(along, across)
    angle = 2.0 * np.pi * np.arange(sectors) / sectors
    circle = np.cos(angle)[None, :, None] * across[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    return loft(line[:, None] + radius * circle)


def direction(z: ArrayLike) -> Array:
    """(3, 3) a rotation whose third column points along z (3,)."""
    third = np.asarray(z, float) / max(float(np.linalg.norm(z)), 1e-12)
    helper = np.array((1.0, 0.0, 0.0)) if abs(third[0]) < 0.9 else np.array((0.0, 1.0, 0.0))
    second = np.cross(third, helper)
    second /= np.linalg.norm(second)
    return np.column_stack([np.cross(second, third), second, third])


def _distance(start: ArrayLike, end: ArrayLike) -> float:
    return float(np.linalg.norm(np.asarray(end, float) - np.asarray(start, float)))


def _between(mesh: Mesh, start: ArrayLike, end: ArrayLike) -> Mesh:
    along = np.asarray(end, float) - np.asarray(start, float)
    return mesh.moved(make_pose(direction(along) if along.any() else None, start))
