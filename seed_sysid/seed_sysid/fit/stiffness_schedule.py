# SPDX-License-Identifier: Apache-2.0
"""How the grasp changes with the grip: gripper width to pressure (linear), pressure to each stiffness (Fig. 2).

The paper found forces and one torque to grow about linearly with pressure, and no reliable trend in other torques; a
trend is therefore only claimed where its interval excludes zero, and the band shown is as wide as the data make it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from seed_core.spatial import Array
from seed_sysid.fit.identification_fit import Solution
from seed_sysid.stiffness_map import AXES

_LEVEL = 0.95
_MEANINGFUL = 0.02  # relative change over the range of pressures that counts as a trend


@dataclass(frozen=True)
class Line:
    """value = mean + slope (x - x_mean), with the slope's standard deviation and that of single values around it."""

    x_mean: float
    mean: float
    slope: float
    slope_std: float
    scatter: float
    degrees: int

    def at(self, x: Array | float) -> Array:
        """Values at x."""
        return np.asarray(self.mean + self.slope * (np.asarray(x, dtype=float) - self.x_mean))

    @property
    def slope_interval(self) -> float:
        """Half width of the slope's 95 % interval; infinite where two points leave nothing to judge it by."""
        quantile = float(student.isf(0.5 * (1.0 - _LEVEL), self.degrees)) if self.degrees > 0 else float("inf")
        return quantile * self.slope_std


@dataclass(frozen=True)
class GripModel:
    """pressure [hPa] over width [m], and each stiffness over pressure with whether it has a trend."""

    pressure: Line
    stiffness: tuple[Line, ...]
    trend: tuple[bool, ...]
    warnings: tuple[str, ...]


def fit_grips(widths: Array, pressures: Array, solution: Solution) -> GripModel | None:
    """The lines through G grips; None for fewer than two pressures."""
    if len(pressures) < 2 or np.ptp(pressures) <= 0.0:
        return None
    lines = tuple(fit_line(pressures, solution.stiffness[:, j], solution.stiffness_std[:, j]) for j in range(6))
    pressure = fit_line(widths, pressures, np.zeros_like(pressures))
    trend = tuple(_has_trend(line, float(np.ptp(pressures))) for line in lines)
    none = [AXES[j] for j in range(6) if not trend[j]]
    warnings = []
    if none:
        warnings.append(
            f"no reliable trend with pressure in {', '.join(none)} (as the paper found for some torques): "
            "values between the measured grips are uncertain by the scatter shown"
        )
    scatter = pressure.scatter / max(float(np.ptp(pressures)), 1e-9)
    if scatter > 0.1:
        warnings.append(f"pressure is not linear in width: it scatters by {scatter:.0%} of its range")
    return GripModel(pressure, lines, trend, tuple(warnings))


def fit_line(x: Array, y: Array, y_std: Array) -> Line:
    """Least squares; the scatter is at least what the deviations of the values explain."""
    center = x - x.mean()
    slope = float(center @ y / (center @ center))
    residual = y - y.mean() - slope * center
    degrees = len(x) - 2
    scatter = float(np.sqrt(residual @ residual / degrees)) if degrees > 0 else 0.0
    scatter = max(scatter, float(np.sqrt(np.mean(y_std**2))))
    return Line(float(x.mean()), float(y.mean()), slope, scatter / float(np.sqrt(center @ center)), scatter, degrees)


def _has_trend(line: Line, span: float) -> bool:
    """Positive beyond its interval, and worth mentioning."""
    return line.slope > line.slope_interval and line.slope * span > _MEANINGFUL * abs(line.mean)
