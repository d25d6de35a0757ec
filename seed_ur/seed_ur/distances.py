# SPDX-License-Identifier: Apache-2.0
"""Distances of segments from each other, from planes and from boxes, for many at once; (..., n, 3) arrays throughout.

Of a capsule they are those of its segment less its radius. Exact, in closed form: no iteration, no library. GJK
libraries (coal, formerly hpp-fcl) answer one pair per call, which for the pairs of an arm takes longer than this.
"""

import numpy as np

from seed_core.spatial import Array

_TINY = 1e-12  # [m^2] below which a segment is a point, or two are parallel


def between_segments(start: Array, end: Array, other_start: Array, other_end: Array) -> Array:
    """Distance (..., n) [m] of each segment from the other of the same place.

    Ericson, Real-Time Collision Detection (2005), 5.1.9: the nearest points of both lines, clamped one after the other.
    """
    u, v, w = end - start, other_end - other_start, start - other_start
    a, e = _dot(u, u) + _TINY, _dot(v, v) + _TINY
    b, c, f = _dot(u, v), _dot(u, w), _dot(v, w)
    s = np.minimum(np.maximum((b * f - c * e) / np.maximum(a * e - b * b, _TINY * a * e), 0.0), 1.0)
    t = np.minimum(np.maximum((b * s + f) / e, 0.0), 1.0)
    s = np.minimum(np.maximum((b * t - c) / a, 0.0), 1.0)
    gap = w + s[..., None] * u - t[..., None] * v
    return np.asarray(np.sqrt(_dot(gap, gap)))


def from_planes(start: Array, end: Array, normals: Array, offsets: Array) -> Array:
    """Signed distance (..., n) [m] of each segment from the plane normal . x = offset, positive on the normal's side.

    Args:
        normals: (n, 3), of length 1. offsets: (n,) [m].
    """
    return np.asarray(np.minimum(_dot(start, normals), _dot(end, normals)) - offsets)


def from_boxes(start: Array, end: Array, rotations: Array, centres: Array, halves: Array) -> Array:
    """Distance (..., n) [m] of each segment from a box; 0 where it meets the box.

    Along the segment the squared distance is convex and made of parabolas that join where the segment crosses a plane
    of the box's faces: the least of all their minima, each clamped to its own stretch.

    Args:
        rotations: (n, 3, 3) of the boxes in the frame of the segments. centres: (n, 3). halves: (n, 3) of the edges.
    """
    a, b = _into(start - centres, rotations), _into(end - centres, rotations)
    d = b - a
    safe = np.where(np.abs(d) < _TINY, 1.0, d)
    joints = np.concatenate(((-halves - a) / safe, (halves - a) / safe, np.zeros_like(a[..., :1])), axis=-1)
    low = np.sort(np.minimum(np.maximum(joints, 0.0), 1.0), axis=-1)  # (..., n, 7)
    high = np.concatenate((low[..., 1:], np.ones_like(low[..., :1])), axis=-1)
    middle = a[..., None, :] + (0.5 * (low + high))[..., None] * d[..., None, :]
    outside = np.where(np.abs(middle) > halves[..., None, :], np.sign(middle), 0.0)  # (..., n, 7, 3)
    slope, rest = outside * d[..., None, :], outside * a[..., None, :] - np.abs(outside) * halves[..., None, :]
    least = -_dot(slope, rest) / (_dot(slope, slope) + _TINY)
    t = np.minimum(np.maximum(least, low), high)
    gap = np.maximum(np.abs(a[..., None, :] + t[..., None] * d[..., None, :]) - halves[..., None, :], 0.0)
    return np.asarray(np.sqrt(_dot(gap, gap).min(axis=-1)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _into(vectors: Array, rotations: Array) -> Array:
    """Vectors written in the boxes' axes."""
    return np.asarray(np.einsum("...i,...ij->...j", vectors, rotations))
