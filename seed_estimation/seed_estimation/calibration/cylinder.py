# SPDX-License-Identifier: Apache-2.0
"""Where two cameras sit against each other, from a cylinder that both of them see: their axes must be one line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from seed_core.errors import SeedError
from seed_core.spatial import Array, make_pose, so3_exp
from seed_estimation.contact.patch import PatchFinder
from seed_estimation.contact.surface import smooth_depth, touches
from seed_estimation.images.tactile_images import Image

PRIOR = np.array([0.05] * 3 + [0.005] * 3)  # [rad], [m] how wrong a drawing of a hand may be
# Deviations of one cylinder's axis as one camera sees it: its place [m], its direction turned about x, y, z of C [rad].
# A turn about the optical axis (y) shows on the cylinder's flanks only.
GAP, TURN = 1e-4, np.array((2.5e-3, 8e-3, 8e-3))


def cylinder_axis(points: Array, radius: float) -> tuple[Array, Array]:
    """A point on the axis and its direction (3,), both in the camera's frame, of a cylinder seen as points (N, 3) [m].

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

    def line(q: Array) -> tuple[Array, Array]:
        d = d0 + q[0] * across + q[1] * into
        return centre + q[2] * across + (radius + q[3]) * into, d / np.linalg.norm(d)

    def residual(q: Array) -> Array:
        a, d = line(q)
        offset = points - a
        return np.asarray((np.linalg.norm(offset - np.outer(offset @ d, d), axis=1) - radius) * 1e3)

    found = least_squares(residual, np.zeros(4), loss="soft_l1")
    if not np.sqrt(np.mean(found.fun**2)) < 2.0:
        raise SeedError(
            f"the points fit a cylinder of {radius * 1e3:g} mm to {np.sqrt(np.mean(found.fun**2)):.1f} mm rms only"
        )
    return line(found.x)


def extrinsics(
    left: Sequence[tuple[Array, Array]], right: Sequence[tuple[Array, Array]], X_CL: Array, X_CR: Array
) -> tuple[Array, Array]:
    """X_CL, X_CR (4, 4), corrected by equal and opposite steps that make both cameras' axes of each pose one line."""

    def corrected(q: Array) -> tuple[Array, Array]:
        half = 0.5 * q * PRIOR
        return make_pose(so3_exp(half[:3]), half[3:]) @ X_CL, make_pose(so3_exp(-half[:3]), -half[3:]) @ X_CR

    def residual(q: Array) -> Array:
        A, B = corrected(q)
        out = [q]  # the drawing counts where nothing else tells
        for (a, d), (b, e) in zip(left, right, strict=True):
            a_C, d_C = A[:3, :3] @ a + A[:3, 3], A[:3, :3] @ d
            b_C, e_C = B[:3, :3] @ b + B[:3, 3], B[:3, :3] @ e
            gap = b_C - a_C
            out += [(gap - (gap @ d_C) * d_C) / GAP, np.cross(d_C, e_C) / TURN]
        return np.concatenate(out)

    return corrected(least_squares(residual, np.zeros(6)).x)


def seen_axis(finder: PatchFinder, depth: Image, radius: float) -> tuple[Array, Array]:
    """The cylinder's axis from the pixels where the membrane lies on it; which those are, its axis tells."""
    depth = depth + finder.correction
    mask, patch = finder.find(depth)
    if not patch.in_contact:
        raise SeedError(f"{finder.finger}: a capture of the grasped cylinder shows no contact")
    smooth = smooth_depth(depth, np.isfinite(depth) & (mask > 0), 1.0)
    seen = (finder.core(depth, mask) > 0) & np.isfinite(smooth)
    points, rest = finder.camera.back_project(smooth, seen), finder.rest[seen]
    line = cylinder_axis(points, radius)
    for _ in range(3):
        a, d = line
        offset = points - a
        outward = offset - np.outer(offset @ d, d)
        n = (outward / np.linalg.norm(outward, axis=1, keepdims=True)).T.astype(np.float32)
        on = touches(rest, points[:, 2].astype(np.float32), n, finder.parameters.decay)
        line = cylinder_axis(points[on], radius)
    return line
