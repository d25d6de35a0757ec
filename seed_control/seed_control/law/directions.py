# SPDX-License-Identifier: Apache-2.0
"""The directions that carry force, from the projector onto them."""

import numpy as np

from seed_core.spatial import Array, length

WORLD = np.eye(3)
_ALIKE = 9  # decimals to which equal shares of two axes are equal
SAME_DIRECTION = 0.7  # square of the cosine: a direction that has turned further than 33 degrees is another one


def force_directions(P: Array, before: Array | None, axes: Array = WORLD) -> tuple[Array, bool]:
    """Orthonormal basis (m, 3) of the range of a projector, and whether it goes on from the one before.

    Each direction follows its own former one as a task frame turns, so that none changes its sign or swaps its place.
    New ones point along positive axes of the task frame, so that they are the same however it stands in the world.

    Args:
        P: (3, 3) projector, of rank m.
        before: the basis in use (any size), or None to start anew.
        axes: (3, 3) of the task frame.
    """
    m = round(float(P[0, 0] + P[1, 1] + P[2, 2]))
    if before is not None and len(before) == m:
        turned = before @ P
        if all(float(new @ old) > SAME_DIRECTION for new, old in zip(turned, before, strict=True)):
            return _orthonormal(turned, m), True
    if m == 3:
        return np.eye(3), False
    in_task = axes.T @ P @ axes
    order = np.argsort(-np.diag(in_task).round(_ALIKE), kind="stable")
    return _orthonormal(in_task[order], m) @ axes.T, False


def _orthonormal(rows: Array, m: int) -> Array:
    """The first m directions (m, 3) of rows that are independent (Gram and Schmidt)."""
    out: list[Array] = []
    for v in rows:
        for n in out:
            v = v - (n @ v) * n
        size = length(v)
        if size > 0.3 and len(out) < m:
            out.append(v / size)
    return np.array(out).reshape(m, 3)
