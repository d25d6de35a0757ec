# SPDX-License-Identifier: Apache-2.0
"""The work frame of a demonstration: origin at the first touch, z out of the surface that was pressed on."""

import numpy as np

from seed_control.teach.demonstration import STEP, Demonstration, TeachError
from seed_control.teach.pieces import Span
from seed_core.spatial import Array, make_pose

MOVING = 0.005  # [m/s] above which friction points against the path
WIDE = 0.02  # [m] that the touched points must spread, across their main direction too, for them to tell the plane
BEHIND = 0.004  # [m] by which a tool that is not touching is behind what it pulls at
STEEP = 0.7  # share of the force that must press, or else it is no pressing


def work_frame(demonstration: Demonstration, touched: list[Span]) -> tuple[Array, float]:
    """The frame X (4, 4) in W, and by how much the touched points leave its plane [m].

    demonstration: in even steps. z is against the pressing force: what friction takes of the force lies along the path.

    Raises:
        TeachError: the force lies along the path rather than across it, or pulls.
    """
    p, f = demonstration.X_W_tip[:, :3, 3], demonstration.forces
    if not touched:
        return make_pose(np.eye(3), p[0]), 0.0
    pressing = np.zeros(3)
    for a, b in touched:
        v = np.gradient(p[a:b], STEP, axis=0)
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        along = np.where(speed > MOVING, v / np.maximum(speed, 1e-9), 0.0)
        pressing += (f[a:b] - np.sum(f[a:b] * along, axis=1, keepdims=True) * along).sum(axis=0)
    every = np.concatenate([p[a:b] for a, b in touched])
    total = np.concatenate([f[a:b] for a, b in touched])
    size = float(np.linalg.norm(pressing)) / len(every)
    if size < STEEP * float(np.linalg.norm(total, axis=1).mean()):
        raise TeachError(
            f"of {np.linalg.norm(total, axis=1).mean():.1f} N only {size:.1f} N press across the path: what is taught "
            "is a surface that is pressed on, in one direction; push less along the path"
        )
    normal = -pressing / np.linalg.norm(pressing)
    _, spread, axes = np.linalg.svd(every - every.mean(axis=0), full_matrices=False)
    if spread[1] * np.sqrt(12.0 / len(every)) > WIDE:  # of points that are spread evenly
        normal = axes[2] * np.sign(axes[2] @ normal)
    free = np.ones(len(p), dtype=bool)
    for a, b in touched:
        free[a:b] = False
    away = p[free] @ normal - np.median(every @ normal)
    if len(away) and np.median(away) < -BEHIND:
        raise TeachError(
            f"the force of {size:.1f} N pulls towards where the tool came from: only pressing can be taught; is the "
            "force that of the tool on the environment?"
        )
    x = np.eye(3)[int(np.argmin(np.abs(normal)))] if abs(normal[0]) > 0.9 else np.array((1.0, 0.0, 0.0))
    x = x - (x @ normal) * normal
    x /= np.linalg.norm(x)
    R = np.column_stack((x, np.cross(normal, x), normal))
    height = (every - p[touched[0][0]]) @ normal
    return make_pose(R, p[touched[0][0]] + np.median(height) * normal), float(np.ptp(height))
