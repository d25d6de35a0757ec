# SPDX-License-Identifier: Apache-2.0
"""The directions that carry force, from the projector onto them."""

from __future__ import annotations

import numpy as np

from seed_core.spatial import Array


def force_directions(P: Array, m: int) -> Array:
    """(m, 3) orthonormal basis of the range of the projector P, always the same one for the same P."""
    if m == 3:
        return np.eye(3)
    if m == 0:
        return np.zeros((0, 3))
    order = np.argsort(-np.diag(P), kind="stable")
    out: list[Array] = []
    for i in order:
        v = P[i].copy()
        for n in out:
            v -= (n @ v) * n
        size = float(np.sqrt(v @ v))
        if size > 0.3:
            out.append(v / size)
        if len(out) == m:
            break
    return np.array(out)
