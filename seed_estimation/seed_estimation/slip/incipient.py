# SPDX-License-Identifier: Apache-2.0
"""Incipient slip: how far the membrane has let go of the tool along the edge of the patch. Friction is near its end.

Pressure and so friction are least where a patch ends: under a sideways load the membrane creeps there first, and the
middle sticks longest. With e = exp(-distance from the edge / CREEP) at each point, the share c of its motion that the
membrane does not follow is taken for c e; Gauss-Newton finds c from the residuals of the infrared images, the pose
being free to give way. c is next to nothing in a patch that sticks, and grows towards the largest load. If the tool
slides, c stays; if the load is taken off, c goes back. The displacement of the markers goes back in both cases.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from seed_core.spatial import Array
from seed_estimation.images.tactile_images import Array32
from seed_estimation.rigid_fit.micro_slip import share_information
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import FingerResiduals

CREEP = 0.002  # [m] from the edge over which creep falls by e
START = 0.05  # [1] deviation of c before anything is seen: a small motion tells nothing


def edge_weights(points: ArrayLike, patch: ArrayLike) -> Array:
    """e (N,) of points (N, 2) in the convex hull of a patch's (M, 2), all along x and z [m]."""
    hull = cv2.convexHull(np.ascontiguousarray(patch, np.float32))
    inside = [cv2.pointPolygonTest(hull, (float(x), float(z)), True) for x, z in np.asarray(points)]
    return np.exp(np.maximum(inside, 0.0) / -CREEP)


def creep_weights(model: FingerModel) -> Array32:
    """e (N,) of the fine level's points."""
    fine = model.levels[1]
    weights = edge_weights(fine.p[[0, 2]].T, np.concatenate((fine.p, model.p), axis=1)[[0, 2]].T)
    return weights.astype(np.float32)


def incipient_slip(finger: FingerResiduals, motion: Array, creep: Array32, hold: Array) -> float:
    """c [1] of one finger after a motion (6,); creep: weights e (N,); hold (6, 6): information that keeps the pose."""
    if finger.image.r.size == 0:
        return 0.0
    column = (motion.astype(np.float32) @ finger.points.J_along) * creep[finger.index]
    evidence = share_information([finger.image], [column], finger.image.H + hold, finger.image.g)
    return evidence.gradient / (evidence.information + START**-2)
