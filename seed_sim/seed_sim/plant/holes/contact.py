# SPDX-License-Identifier: Apache-2.0
"""The load of a plate with a hole on the peg that is in or over it: points of either in the body of the other."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose, length, make_pose, rotation_from_rpy
from seed_sim.plant.holes.edges import depth_in, normal_of
from seed_sim.plant.holes.friction import StickSlip
from seed_sim.plant.holes.parameters import HoleSection
from seed_sim.plant.holes.section import Section

Indices = NDArray[np.intp]
SUBSTEPS = 3  # of a millisecond, at least: contact is as stiff as parts of metal are rough
_DISSIPATION = 1.0  # [s/m] Hunt and Crossley's
_NEAR = 1e-3  # [m] over the plate
_Z = np.array((0.0, 0.0, 1.0))


class HoleLoad(NamedTuple):
    """What the tool bears of plate and hole: torque about T's origin and force, in the world (3,) [N m], [N]."""

    torque: Array
    force: Array


NOTHING = HoleLoad(np.zeros(3), np.zeros(3))


class HoleContact:
    """A plate with a hole, as one seed has drawn it.

    The peg's end is two outlines, at its face and where its chamfer ends; they meet plate, chamfer, wall and bottom of
    the hole. The hole's mouth is two outlines likewise, which meet the peg's face, chamfer and wall. With both together
    a tilted peg touches at two points, as in Whitney's analysis (1982).

    Attributes:
        X_WH: (4, 4) the hole: origin in the middle of its mouth, z out of the plate.
        friction: Coulomb's.
        deepest: [m] that the peg's end has been below the plate.
        largest: [N] largest net force since the start.
        squeeze: [N] largest sum of what all points bear by themselves: a wedged peg is squeezed from both sides, of
            which the net force tells nothing.
    """

    def __init__(self, hole: HoleSection, X_Ttip: Array, X_WS: Array, rng: np.random.Generator) -> None:
        """On the surface X_WS (4, 4), for a tool whose peg ends at the tip X_Ttip (4, 4)."""
        angle, r = rng.uniform(0.0, 2.0 * np.pi), 1e-3 * hole.away * np.sqrt(rng.uniform())
        yaw = np.deg2rad(rng.uniform(-hole.yaw, hole.yaw))
        place = make_pose(rotation_from_rpy((0.0, 0.0, yaw)), (r * np.cos(angle), r * np.sin(angle), 0.0))
        self.section, self.friction = hole, float(rng.uniform(*hole.friction))
        self.X_WH: Array = X_WS @ place
        self._to_hole, self._X_Ttip = inverse_pose(self.X_WH), X_Ttip
        self._chamfer, self._peg_chamfer = 1e-3 * hole.chamfer, 1e-3 * hole.peg_chamfer
        self._peg = Section(hole.shape == "round", 0.5 * hole.width[0], 0.5 * hole.width[1])
        self._hole = self._peg.grown(5e-4 * hole.clearance)
        self._end = _edges(self._peg, -self._peg_chamfer)
        self._mouth = _edges(self._hole, self._chamfer) if hole.drilled else np.zeros((0, 3))
        self._stick = StickSlip(2 * len(self._end) + len(self._mouth), self.friction, hole.stiffness)
        self.reset()

    def reset(self) -> None:
        """As it was built: nothing touches, and nothing has."""
        self.largest = self.squeeze = self.deepest = 0.0
        self.part()

    def part(self) -> None:
        """Nothing touches: the peg is away, or the tool is taken anew."""
        self._stick.restart()
        self._load = NOTHING

    @property
    def load(self) -> HoleLoad:
        """The newest."""
        return self._load

    def place_of(self, X_WT: Array) -> Array:
        """(4, 4) of the peg in the hole's frame: its x and y, its z negative by how deep the end is."""
        return np.asarray(self._to_hole @ X_WT @ self._X_Ttip)

    def update(self, X_WT: Array, V: Array, dt: float) -> HoleLoad:
        """The load on the tool at X_WT (4, 4), which has moved for dt [s].

        Args:
            V: (6,) of the tool: angular velocity [rad/s], then that of T's origin [m/s], in the world.
        """
        X = self.place_of(X_WT)
        R, p = X[:3, :3], X[:3, 3]
        end = self._end @ R.T + p
        self.deepest = max(self.deepest, -float(p[2]))
        if end[:, 2].min() > _NEAR:
            if self._load is not NOTHING:
                self.part()
            return self._load
        at, normal, depth, on = self._touching(end, R, p)
        if len(on) == 0:
            self.part()
            return NOTHING
        R_HW = self._to_hole[:3, :3]
        w = R_HW @ V[:3]
        origin = R_HW @ X_WT[:3, 3] + self._to_hole[:3, 3]
        velocity = R_HW @ V[3:] + _crossed(w, at - origin)
        away = (velocity * normal).sum(axis=1)
        force = self.section.stiffness * depth * np.clip(1.0 - _DISSIPATION * away, 0.0, 2.0)
        forces = force[:, None] * normal
        forces += self._stick.force(on, normal, velocity - away[:, None] * normal, force, dt)
        total, torque = forces.sum(axis=0), _crossed(at - origin, forces).sum(axis=0)
        self.largest = max(self.largest, length(total))
        self.squeeze = max(self.squeeze, float(np.sqrt((forces * forces).sum(axis=1)).sum()))
        self._load = HoleLoad(R_HW.T @ torque, R_HW.T @ total)
        return self._load

    def _touching(self, end: Array, R: Array, p: Array) -> tuple[Array, Array, Array, Indices]:
        """Points that touch (m, 3), unit normals towards the peg (m, 3), depths (m,), in H; and which they are (m,)."""
        below = -end[:, 2]
        beyond = self._hole.distance(end) if self.section.drilled else np.ones(len(end))
        mouth = (self._mouth - p) @ R  # in the tip's frame, whose z points out of the tool
        inside, short = -self._peg.distance(mouth), -mouth[:, 2]
        floor = np.where(beyond < _NEAR, below - self.section.depth, -1.0)
        depth = np.concatenate(
            [depth_in(beyond, below, self._chamfer), floor, depth_in(inside, short, self._peg_chamfer)]
        )
        on: Indices = np.flatnonzero(depth > 0.0)
        if len(on) == 0:
            return end[:0], end[:0], depth[:0], on
        n = len(end)
        w, b = on[on < n], on[on >= 2 * n] - 2 * n
        side = -self._hole.outward(end[w])
        n_wall = normal_of(beyond[w], below[w], self._chamfer, side, _Z) if self.section.drilled else _up(len(w))
        n_body = normal_of(inside[b], short[b], self._peg_chamfer, self._peg.outward(mouth[b]), _Z)
        normals = np.concatenate([n_wall, _up(len(on) - len(w) - len(b)), -n_body @ R.T])
        points = np.concatenate([end[w], end[on[(on >= n) & (on < 2 * n)] - n], self._mouth[b]])
        return points, normals, depth[on], on


def _edges(section: Section, chamfer: float) -> Array:
    """Points (n, 3) of both edges of a chamfer, which widens (positive) or narrows the section at its face z = 0."""
    at_face = section.grown(chamfer).outline(0.0)
    return np.concatenate([at_face, section.outline(-abs(chamfer))]) if chamfer else at_face


def _up(n: int) -> Array:
    return np.tile(_Z, (n, 1))


def _crossed(a: Array, b: Array) -> Array:
    """Rows (n, 3) of a cross those of b; either may be one row."""
    x, y, z = a.T
    u, v, w = b.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)
