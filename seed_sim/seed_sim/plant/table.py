# SPDX-License-Identifier: Apache-2.0
"""The table of one seed: tilted about the work frame's axes, off in height, and of a shape of its own."""

from dataclasses import dataclass
from math import cos, pi, sin
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, make_pose, rotation_from_rpy
from seed_core.vector3 import as_vector3
from seed_sim.plant.surfaces.draw import draw_shapes
from seed_sim.plant.surfaces.shapes import Shape
from seed_sim.scenario import TableSection


class Touch(NamedTuple):
    """The surface next to a place: distance from it [m], below zero inside, and its unit normal (3,) in W."""

    distance: float
    normal: Array


@dataclass(frozen=True)
class Surface:
    """Surface of the table: X_WS (4, 4) with z out of it, its friction, and the stiffness of a contact point [N/m].

    A plane at rest ends at x = edge [m]; any other surface is made of `shapes`, and moves along z by
    swing sin(rate t + phase) [m].
    """

    X_WS: Array
    friction: float
    point_stiffness: float
    edge: float
    shapes: tuple[Shape, ...] = ()
    swing: float = 0.0
    rate: float = 0.0
    phase: float = 0.0

    def moved(self, t: float) -> tuple[float, float]:
        """How far it is along its z at time t [s], and how fast: [m], [m/s]."""
        angle = self.rate * t + self.phase
        return self.swing * sin(angle), self.swing * self.rate * cos(angle)

    def touches(self, p: Array, t: float) -> list[Touch]:
        """Each of the shapes next to p (3,) [m] in W at time t [s]."""
        R = self.X_WS[:3, :3]
        in_S = R.T @ (p - self.X_WS[:3, 3])
        in_S[2] -= self.moved(t)[0]
        place = as_vector3(in_S)
        if not self.shapes:
            return [Touch(place[2], R[:, 2])]
        return [Touch(d, R @ n) for d, n in (s.nearest(place) for s in self.shapes)]

    def nearest(self, p: Array, t: float = 0.0) -> Touch:
        """The surface next to p (3,) [m] in W at time t [s]."""
        return min(self.touches(p, t), key=lambda touch: touch.distance)

    def height(self, x: Array, y: Array) -> Array:
        """Height over places x, y (...) [m] in S, to look at."""
        if not self.shapes:
            return np.zeros_like(x)
        return np.asarray(np.fmax.reduce([s.height(x, y) for s in self.shapes]))


def draw_surface(table: TableSection, X_W_work: Array, rng: np.random.Generator, points: int, seed: int = 0) -> Surface:
    """The surface under the work frame X_W_work (4, 4), which `points` contact points of the tool share.

    rng draws how the table stands, the seed its shape.
    """
    tilt = np.deg2rad([rng.uniform(*table.tilt_x), rng.uniform(*table.tilt_y), 0.0])
    X = make_pose(rotation_from_rpy(tilt), (0.0, 0.0, 1e-3 * rng.uniform(*table.height)))
    shared = table.contact_stiffness if table.total_stiffness is None else table.total_stiffness / points
    if table.surface.flat:
        return Surface(X_W_work @ X, table.friction, shared, table.edge)
    of_shape = np.random.default_rng([seed, 5])
    shapes, turn = draw_shapes(table.surface, table.edge, of_shape)
    X_WS = X_W_work @ X @ make_pose(rotation_from_rpy((0.0, 0.0, turn)), (0.0, 0.0, 0.0))
    swing, rate = 1e-3 * table.surface.swing, 2.0 * pi * table.surface.frequency
    return Surface(X_WS, table.friction, shared, table.edge, shapes, swing, rate, of_shape.uniform(0.0, 2.0 * pi))
