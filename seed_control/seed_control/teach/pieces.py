# SPDX-License-Identifier: Apache-2.0
"""Pieces of a demonstration: where it touches, where it presses with one force, and the corners of its path."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array

Span = tuple[int, int]  # first sample, and the one after the last


def corners(points: Array, tolerance: float) -> list[int]:
    """Samples of a curve (n, d) whose polyline it leaves by at most the tolerance, the ends among them.

    Ramer 1972, Douglas and Peucker 1973: the farthest point from a chord becomes a corner, and so on on both sides.
    """
    kept, waiting = {0, len(points) - 1}, [(0, len(points) - 1)]
    while waiting:
        a, b = waiting.pop()
        if b - a < 2:
            continue
        chord, inner = points[b] - points[a], points[a + 1 : b] - points[a]
        share = np.clip(inner @ chord / max(chord @ chord, 1e-18), 0.0, 1.0)
        away = np.linalg.norm(inner - share[:, None] * chord, axis=1)
        k = int(np.argmax(away))
        if away[k] > tolerance:
            kept.add(a + 1 + k)
            waiting += [(a, a + 1 + k), (a + 1 + k, b)]
    return sorted(kept)


def spans(mask: NDArray[np.bool_]) -> Iterator[Span]:
    """Where a mask (n,) is true, one stretch after the other."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    yield from ((int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))


def touches(force: Array, touch: float, least: int) -> list[Span]:
    """Where a force (n,) [N] is above `touch`, until it is below half of it; stretches under `least` are none."""
    touching, mask = False, np.zeros(len(force), dtype=bool)
    for i, value in enumerate(force):
        touching = value > (0.5 * touch if touching else touch)
        mask[i] = touching
    for a, b in list(spans(~mask)):
        if b - a < least and a > 0 and b < len(mask):
            mask[a:b] = True
    return [(a, b) for a, b in spans(mask) if b - a >= least]


class Level(NamedTuple):
    """A piece of a demonstration with one force.

    Attributes:
        start: its first sample, of the rise or fall that leads to it. there: first sample at which the force is there.
        end: after its last.
        size: [N].
    """

    start: int
    there: int
    end: int
    size: float


def levels(force: Array, band: float, least: int) -> list[Level]:
    """A force (n,) [N] as pieces of one size each: within `band` of their middle, and at least so many samples long.

    What rises or falls faster than that belongs to the piece that it leads to; at the end, to none: there the tool is
    let go.
    """
    found: list[list[float]] = []  # first, end, size
    start = 0
    while start < len(force):
        low = high = force[start]
        end = start + 1
        while end < len(force) and max(high, force[end]) - min(low, force[end]) <= 2.0 * band:
            low, high = min(low, force[end]), max(high, force[end])
            end += 1
        if end - start >= least:
            size = float(np.mean(force[start:end]))
            if found and abs(found[-1][2] - size) <= band:  # a short excursion in between is none
                a, b, before = found[-1]
                found[-1] = [a, end, (before * (b - a) + size * (end - start)) / (b - a + end - start)]
            else:
                found.append([start, end, size])
            start = end
        else:
            start += 1
    if not found:
        size = float(np.percentile(force, 75.0))
        there = np.flatnonzero(force >= size)
        found = [[int(there[0]), int(there[-1]) + 1, size]]
    last = found[-1]
    near = np.flatnonzero(np.abs(force - last[2]) <= band)  # none where a short tap only passes through its size
    last[1] = max(last[1], float(near[-1]) + 1 if len(near) else 0.0)  # noise does not end it
    starts = [0, *(int(f[1]) for f in found[:-1])]
    return [Level(a, int(f[0]), int(f[1]), f[2]) for a, f in zip(starts, found, strict=True)]


def rested(points: Array, reach: float, least: int) -> Array:
    """A path (n, d) [m] on which a tip that stands is at one place: the mean of samples that stay within reach of it.

    reach: [m]. least: samples of a stand.
    """
    out, a = points.copy(), 0
    while a < len(points):
        b = a + 1
        while b < len(points) and np.linalg.norm(points[b] - points[a:b].mean(axis=0)) < reach:
            b += 1
        if b - a >= least:
            out[a:b] = points[a:b].mean(axis=0)
            a = b
        else:
            a += 1
    return out


def moves(points: Array, step: float, slow: float, least: int) -> list[tuple[Span, bool]]:
    """Stretches of a path (n, d) [m] in turn, and whether it moves there: faster than slow [m/s], or but briefly not.

    step: [s] between two samples.
    """
    n = len(points)
    half = max(least // 4, 1)
    i = np.arange(n)
    ahead, behind = np.minimum(i + half, n - 1), np.maximum(i - half, 0)
    speed = np.linalg.norm(points[ahead] - points[behind], axis=1) / np.maximum((ahead - behind) * step, 1e-9)
    moving = speed > slow
    for a, b in list(spans(~moving)):
        if b - a < least:
            moving[a:b] = True
    for a, b in list(spans(moving)):
        if np.linalg.norm(np.ptp(points[a:b], axis=0)) < slow * step * least:
            moving[a:b] = False
    edges = [0, *(np.flatnonzero(np.diff(moving)) + 1).tolist(), n]
    return [((a, b), bool(moving[a])) for a, b in pairwise(edges) if b > a]


def speed_of(length: float, duration: float, acceleration: float, low: float, high: float) -> float:
    """Speed [m/s] with which a path of so many [m], from rest to rest, takes so many [s]; within low and high."""
    root = duration * duration - 4.0 * length / acceleration
    speed = 0.5 * acceleration * (duration - np.sqrt(root)) if root > 0.0 else np.sqrt(acceleration * length)
    return float(np.clip(speed, low, high))
