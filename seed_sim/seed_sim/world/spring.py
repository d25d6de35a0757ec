# SPDX-License-Identifier: Apache-2.0
"""A spring that a stiffness map is not: it stiffens, it has hysteresis and an elastic centre of its own, it relaxes.

Along each generalised coordinate xi of the stiffness map (Theorem 1: rpy, and the translation half rotated), about the
elastic centre, the load is

    k xi (1 + s |xi| / full)  +  sum_i h_i z_i  -  relaxed part  +  d xi_dot

with a parallel row of Prandtl's elements, springs that slide at friction h_i after a way of y_i: z_i in [-1, 1] follows
d xi / y_i. One element gives a parallelogram, several the rounded loop of a membrane whose patch lets go from its
edge inwards. A loop of amplitude A >= y_i loses sum_i 4 h_i (A - y_i).
"""

from math import exp

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.hysteretic.spring import coordinates
from seed_core.spatial import Array, Wrench, cross
from seed_sim.world.parameters import SpringWorld

YIELDS = (0.05, 0.1, 0.2, 0.4)  # [full scale] of the way after which an element slides; all bear the same friction


class WorldSpring:
    """A `GraspForce` of the plant. Time must not fall between two calls; `reset` starts at the grasp anew.

    Attributes:
        stiffness: of the springs alone, at rest and without friction [N m/rad, N/m].
    """

    def __init__(self, stiffness: Stiffness, world: SpringWorld, damping: Array | None = None) -> None:
        """The spring of a world.

        Args:
            stiffness: that the scenario states, which the world scales.
            world: what differs.
            damping: (6,) [N m s/rad, N s/m] along the coordinates; none without it.
        """
        self.world = world
        k = stiffness.vector() * np.array(world.scale)
        self.stiffness = Stiffness.from_vector(k)
        full = np.repeat([np.deg2rad(world.full_turn_deg), world.full_translation], 3)
        self.full, self._k, self._rise = full, k, k * world.stiffening / full
        self.damping = np.zeros(6) if damping is None else damping
        self.friction = world.hysteresis * k * full  # (6,) of all elements together
        self.yields = np.outer(YIELDS, full)  # (elements, 6)
        self._centre = 1e-3 * np.array(world.centre_mm)
        self.reset(0.0)

    def reset(self, t: float) -> None:
        """At rest in the grasp, at time t [s]."""
        self._z = np.zeros_like(self.yields)
        self._xi, self._relaxed = np.zeros(6), np.zeros(6)
        self._t = t

    def wrench(self, X_TC: Array, V_TC: Array, t: float) -> Wrench:
        """Load on the tool about T's origin, in T; see `seed_sim.plant.grasp_force.GraspForce`."""
        e, R = self._centre, X_TC[:3, :3]
        Re = R @ e
        B, xi = coordinates(R, X_TC[:3, 3] + Re - e)
        w, v = V_TC[:3], V_TC[3:] + cross(V_TC[:3], Re)  # of the centre fixed in C
        rate = B.T @ np.concatenate([w, v - cross(w, X_TC[:3, 3] + Re - e)])
        load = B @ (self._load(xi, t) + self.damping * rate)
        torque, force = load[:3], load[3:]
        return Wrench(torque + cross(e, force), force)

    def static(self, X_TC: Array, t: float = 0.0) -> Wrench:
        """The same of a pose that rests."""
        return self.wrench(X_TC, np.zeros(6), t)

    def _load(self, xi: Array, t: float) -> Array:
        """(6,) along the coordinates."""
        world = self.world
        dt, self._t = t - self._t, t
        if world.hysteresis > 0.0:
            self._z = np.clip(self._z + (xi - self._xi) / self.yields, -1.0, 1.0)
        if world.relaxation > 0.0:
            self._relaxed += (1.0 - exp(-dt / world.relaxation_time)) * (xi - self._relaxed)
        self._xi = xi
        elastic = self._k * (xi - world.relaxation * self._relaxed) + self._rise * np.abs(xi) * xi
        if world.fade:
            elastic = elastic * (1.0 - world.fade * min(max(t / world.fade_time, 0.0), 1.0))
        return np.asarray(elastic + self.friction * self._z.mean(axis=0))
