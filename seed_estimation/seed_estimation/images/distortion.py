# SPDX-License-Identifier: Apache-2.0
"""Brown and Conrady's lens distortion and its inverse.

With r2 = x^2 + y^2 and c = 1 + k1 r2 + k2 r2^2 + k3 r2^3, and coefficients D = k1 k2 p1 p2 k3:

    B(x, y) = (x c + 2 p1 x y + p2 (r2 + 2 x^2), y c + p1 (r2 + 2 y^2) + 2 p2 x y)
"""

import numpy as np

from seed_core.spatial import Array

_STEPS = 20  # Newton steps; the strongest lens in use needs 6
_EXACT = 1e-9  # [1], on unit-z rays: 2e-7 px


def brown(x: Array, y: Array, D: Array) -> tuple[Array, Array]:
    """B(x, y) of points [1] on the plane z = 1; D (5,)."""
    k1, k2, p1, p2, k3 = (float(d) for d in D)
    r2 = x * x + y * y
    c = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return x * c + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * c + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y


def inverse_brown(a: Array, b: Array, D: Array) -> tuple[Array, Array]:
    """x, y with B(x, y) = (a, b), by Newton's method from (a, b); NaN where it does not converge (outside the lens)."""
    if not D.any():
        return np.array(a), np.array(b)
    k1, k2, p1, p2, k3 = (float(d) for d in D)
    x, y = np.array(a, dtype=float), np.array(b, dtype=float)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            fx, fy = brown(x, y, D)
            ex, ey = fx - a, fy - b
            if np.nanmax(np.abs(ex) + np.abs(ey), initial=0.0) < 1e-14:
                break
            r2 = x * x + y * y
            c = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
            xx = c + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
            xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
            yy = c + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
            det = xx * yy - xy * xy
            x, y = x - (yy * ex - xy * ey) / det, y - (xx * ey - xy * ex) / det
        fx, fy = brown(x, y, D)
        converged = np.abs(fx - a) + np.abs(fy - b) < _EXACT
    return np.where(converged, x, np.nan), np.where(converged, y, np.nan)


def fitted_inverse(a: Array, b: Array, D: Array) -> tuple[Array, float]:
    """Coefficients (5,) of the B that best undoes B with D at points a, b (N,), and its worst error [1]."""
    x, y = brown(a, b, D)
    columns = np.array([np.concatenate(brown(x, y, one)) - np.concatenate((x, y)) for one in np.eye(5)]).T
    shift = np.concatenate((a - x, b - y))
    fitted = np.linalg.lstsq(columns, shift, rcond=None)[0]
    return fitted, float(np.abs(columns @ fitted - shift).max())
