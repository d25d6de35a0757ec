# SPDX-License-Identifier: Apache-2.0
"""How Drake touches a surface that is not flat: by tangent planes that follow the tool.

Under each contact point of the tool, and for each shape, stands a box whose upper side is the tangent plane at the
shape's nearest point. It is put there anew at every step, so a tip slides over the very surface, and contact and
friction are those of the flat table. The boxes are free bodies so heavy that no load moves them, as the gripper is; of
a table that moves they have its velocity.
"""

from typing import Any

import numpy as np
from pydrake import geometry as dg
from pydrake.math import RigidTransform
from pydrake.multibody import tree as dt

from seed_core.arm.quaternion import as_quaternion
from seed_core.meshes.shapes import direction
from seed_core.spatial import Array
from seed_sim.plant.table import Surface

_MASS = 1e4  # [kg]
_SIZE = 0.1  # [m] of a box


class Patches:
    """Tangent planes under contact points.

    Args:
        plant, scene: Drake's, before they are finished.
        surface: what is touched.
        tips: geometry of each contact point. others: all else that tools touch.
        properties: of the contact with the table.
    """

    def __init__(
        self, plant: Any, scene: Any, surface: Surface, tips: list[Any], others: list[Any], properties: Any
    ) -> None:
        self._surface, self._plant = surface, plant
        heavy = dt.SpatialInertia.SolidBoxWithMass(_MASS, 1, 1, 1)
        model = plant.AddModelInstance("table")
        plant.set_gravity_enabled(model, False)
        box, X = dg.Box(_SIZE, _SIZE, _SIZE), RigidTransform(np.array((0.0, 0.0, -0.5 * _SIZE)))
        self._bodies: list[list[Any]] = []
        touching: list[tuple[Any, Any]] = []
        for i, tip in enumerate(tips):
            row = []
            for j in range(len(surface.shapes)):
                body = plant.AddRigidBody(f"table{i}_{j}", model, heavy)
                touching.append((tip, plant.RegisterCollisionGeometry(body, X, box, f"table{i}_{j}", properties)))
                row.append(body)
            self._bodies.append(row)
        filters = scene.collision_filter_manager()
        boxes = dg.GeometrySet([geometry for _, geometry in touching])
        filters.Apply(dg.CollisionFilterDeclaration().ExcludeWithin(boxes))
        for tip, geometry in touching:
            apart = dg.GeometrySet([*others, *(t for t in tips if t != tip)])
            filters.Apply(dg.CollisionFilterDeclaration().ExcludeBetween(dg.GeometrySet(geometry), apart))

    def find(self) -> None:
        """Where the bodies stand in the state of the finished plant."""
        nq = self._plant.num_positions()
        self._at = [
            [(b.floating_positions_start(), nq + b.floating_velocities_start_in_v()) for b in row]
            for row in self._bodies
        ]

    def place(self, state: Array, points: Array, t: float) -> None:
        """Write poses and velocities of all tangent planes into the state.

        Args:
            points: (n, 3) [m] centres of the contact spheres, in W. t: [s].
        """
        velocity = self._surface.X_WS[:3, 2] * self._surface.moved(t)[1]
        for point, row in zip(points, self._at, strict=True):
            for (q, v), (distance, normal) in zip(row, self._surface.touches(point, t), strict=True):
                x, y, z, w = as_quaternion(direction(normal))
                state[q : q + 4] = (w, x, y, z)
                state[q + 4 : q + 7] = point - distance * normal
                state[v : v + 3] = 0.0
                state[v + 3 : v + 6] = velocity
