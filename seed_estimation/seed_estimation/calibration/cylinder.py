# SPDX-License-Identifier: Apache-2.0
"""Places of two cameras against each other, from a cylinder that both of them see: their axes must be one line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from seed_core.errors import SeedError
from seed_core.spatial import Array, make_pose, so3_exp
from seed_estimation.contact.membrane import Membrane
from seed_estimation.contact.patch import PatchFinder
from seed_estimation.contact.surface import lies_on_tool, smooth_depth
from seed_estimation.images.tactile_images import Image
from seed_estimation.parameters import EstimatorParameters

PRIOR = np.array([0.05] * 3 + [0.005] * 3)  # [rad], [m] how wrong a drawing of a hand may be
# Deviations of one cylinder's axis as one camera sees it: its place [m], its direction turned about x, y, z of C [rad].
# A turn about the optical axis (y) shows on the cylinder's flanks only.
GAP, TURN = 1e-4, np.array((2.5e-3, 8e-3, 8e-3))


# In those deviations: axes of a good capture agree to 0.4, and the cameras' poses err as if by 0.25, since what all
# poses of the cylinder share cancels; better agreement is chance.
SHARE, LEAST = 0.6, 0.25


class Line(NamedTuple):
    """A point p (3,) [m] on a line and its unit direction d (3,)."""

    p: Array
    d: Array

    def moved(self, X: Array) -> Line:
        """The same line in another frame, of pose X (4, 4)."""
        return Line(X[:3, :3] @ self.p + X[:3, 3], X[:3, :3] @ self.d)

    def angle(self, other: Line) -> float:
        """Between both lines, whichever way they point [rad]."""
        return float(np.arccos(min(1.0, abs(float(self.d @ other.d)))))

    def offsets(self, points: Array) -> Array:
        """(N, 3) from the line to points (N, 3) [m], at right angles to it."""
        offset = points - self.p
        return np.asarray(offset - np.outer(offset @ self.d, self.d))


def extrinsics(left: Sequence[Line], right: Sequence[Line], X_CL: Array, X_CR: Array) -> tuple[Array, Array, Array]:
    """X_CL, X_CR (4, 4), corrected by equal and opposite steps that make both cameras' axes of each grasp one line.

    And how well they tell the cameras' poses to each other: standard deviations (6,) about and along x, y, z of C
    [rad, m], by how well the axes agree afterwards.
    """

    def corrected(q: Array) -> tuple[Array, Array]:
        half = 0.5 * q * PRIOR
        return make_pose(so3_exp(half[:3]), half[3:]) @ X_CL, make_pose(so3_exp(-half[:3]), -half[3:]) @ X_CR

    def residual(q: Array) -> Array:
        A, B = corrected(q)
        out = [q]  # the drawing counts where nothing else tells
        for a, b in zip(left, right, strict=True):
            a_C, b_C = a.moved(A), b.moved(B)
            gap = b_C.p - a_C.p
            out += [(gap - (gap @ a_C.d) * a_C.d) / GAP, np.cross(a_C.d, b_C.d) / TURN]
        return np.concatenate(out)

    found = least_squares(residual, np.zeros(6))
    of_axes, J = found.fun[6:], np.asarray(found.jac)[6:]
    rms = float(np.sqrt(of_axes @ of_axes / max(4 * len(left) - 6, 1)))  # four numbers tell an axis
    scatter = max(SHARE * rms, LEAST)
    std = PRIOR * np.sqrt(np.diag(np.linalg.inv(np.eye(6) + J.T @ J / scatter**2)))
    return *corrected(found.x), std


def seen_axis(membrane: Membrane, depth: Image, radius: float, p: EstimatorParameters) -> Line:
    """Axis of a grasped cylinder in depth (H, W) [m], from the pixels where the membrane lies on it; radius [m].

    Which those are, its axis tells: the two are found in turns.

    Raises:
        SeedError: no contact, too few points, or they are no such cylinder.
    """
    finder = PatchFinder(membrane)
    depth = depth + membrane.correction
    mask, patch = finder.find(depth, p)
    if not patch.in_contact:
        raise SeedError(f"{membrane.finger}: a capture of the grasped cylinder shows no contact")
    smooth = smooth_depth(depth, np.isfinite(depth) & (mask > 0), 1.0)
    seen = (finder.core(depth, mask, p) > 0) & np.isfinite(smooth)
    points, rest = membrane.camera.back_project(smooth, seen), membrane.rest[seen]
    line = cylinder_axis(points, radius)
    for _ in range(3):
        outward = line.offsets(points)
        n = (outward / np.linalg.norm(outward, axis=1, keepdims=True)).T.astype(np.float32)
        line = cylinder_axis(points[lies_on_tool(rest, points[:, 2].astype(np.float32), n, p.decay)], radius)
    return line


def cylinder_axis(points: Array, radius: float) -> Line:
    """Axis of a cylinder seen as points (N, 3) [m], in the camera's frame; radius [m].

    Raises:
        SeedError: too few points, or they are no such cylinder to 2 mm.
    """
    if len(points) < 100:
        raise SeedError(f"{len(points)} pixels show the cylinder; at least 100 are needed: grasp it more firmly")
    centre = points.mean(axis=0)
    _, _, Vt = np.linalg.svd(points - centre, full_matrices=False)
    d0 = Vt[0] if abs(Vt[0][2]) < 0.8 else Vt[1]
    across = np.cross(d0, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    into = np.cross(across, d0)
    into *= np.sign(into[2])

    def line(q: Array) -> Line:
        d = d0 + q[0] * across + q[1] * into
        return Line(centre + q[2] * across + (radius + q[3]) * into, d / np.linalg.norm(d))

    def residual(q: Array) -> Array:
        return np.asarray((np.linalg.norm(line(q).offsets(points), axis=1) - radius) * 1e3)  # [mm]

    found = least_squares(residual, np.zeros(4), loss="soft_l1")
    rms = np.sqrt(np.mean(found.fun**2))
    if not rms < 2.0:
        raise SeedError(f"the points fit a cylinder of {radius * 1e3:g} mm to {rms:.1f} mm rms only")
    return line(found.x)
