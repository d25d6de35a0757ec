# SPDX-License-Identifier: Apache-2.0
"""The table of one seed: tilted about the work frame's axes, and off in height."""

from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array, make_pose, rotation_from_rpy
from seed_sim.scenario import TableSection


@dataclass(frozen=True)
class Surface:
    """Surface of the table: X_WS (4, 4) with z out of it, its friction, and the stiffness of a contact point [N/m].

    It ends at x = edge [m].
    """

    X_WS: Array
    friction: float
    point_stiffness: float
    edge: float


def draw_surface(table: TableSection, X_W_work: Array, rng: np.random.Generator, points: int) -> Surface:
    """The surface under the work frame X_W_work (4, 4), which `points` contact points of the tool share."""
    tilt = np.deg2rad([rng.uniform(*table.tilt_x), rng.uniform(*table.tilt_y), 0.0])
    X = make_pose(rotation_from_rpy(tilt), (0.0, 0.0, 1e-3 * rng.uniform(*table.height)))
    shared = table.contact_stiffness if table.total_stiffness is None else table.total_stiffness / points
    return Surface(X_W_work @ X, table.friction, shared, table.edge)
