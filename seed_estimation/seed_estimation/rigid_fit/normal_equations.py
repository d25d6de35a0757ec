# SPDX-License-Identifier: Apache-2.0
"""Small systems H x = g of Gauss-Newton's, H symmetric and positive definite."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from seed_core.spatial import Array


def solved(H: Array, g: Array) -> Array:
    """x (N,) by Cholesky, for a quarter of what numpy's general solver costs at N = 6.

    Raises:
        numpy.linalg.LinAlgError: H (N, N) is not positive definite.
    """
    _, x, info = dposv(H, g)
    if info:
        raise np.linalg.LinAlgError("the information matrix is not positive definite")
    return np.asarray(x)
