# SPDX-License-Identifier: Apache-2.0
"""How far the membrane has let go of the tool along the edge of the patch: the sign that friction is near its end.

Pressure and so friction are least where a patch ends: under a sideways load the membrane creeps there first, and the
middle sticks longest. With e = exp(-distance from the edge / CREEP) at each point, the share c of its motion that the
membrane does not follow is taken for c e; Gauss-Newton finds c from the residuals of the infrared images, the pose
being free to give way. c is next to nothing in a patch that sticks, grows towards the largest load, and stays while
the tool slides; a tool that is set free takes it back. Unlike the displacement of the dots it tells both cases apart.
"""

from __future__ import annotations

import cv2
import numpy as np

from seed_core.spatial import Array
from seed_estimation.contact.surface import Vec
from seed_estimation.rigid_fit.normal_equations import solved
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import Sight

CREEP = 0.002  # [m] from the edge over which creep falls by e
START = 0.05  # [1] deviation of c before anything is seen: a small motion tells nothing


def creep_weights(model: FingerModel) -> Vec:
    """e (N,) of the fine level's points; the edge is that of the patch's convex hull, along x and z."""
    points = np.ascontiguousarray(np.concatenate((model.levels[1].p, model.p), axis=1)[[0, 2]].T)
    hull = cv2.convexHull(points)
    inside = [cv2.pointPolygonTest(hull, (float(x), float(z)), True) for x, z in points[: model.levels[1].value.size]]
    return np.exp(np.maximum(inside, 0.0) / -CREEP).astype(np.float32)


def peel(sight: Sight, motion: Array, creep: Vec, hold: Array) -> float:
    """c [1] of one finger after a motion (6,); creep: its weights; hold (6, 6): information that keeps the pose."""
    b = sight.image
    if b.r.size == 0:
        return 0.0
    column = (motion.astype(np.float32) @ sight.points.J_along) * creep[sight.index]
    H_c, H_cc = (b.Jw @ column) * b.scale, float(column @ (b.w * column)) * b.scale
    g_c = float(column @ (b.w * b.r)) * b.scale
    effect = solved(b.H + hold, H_c)
    information = max(H_cc - float(H_c @ effect), 0.0)
    return (g_c - float(b.g @ effect)) / (information + START**-2)
