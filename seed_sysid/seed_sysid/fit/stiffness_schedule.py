# SPDX-License-Identifier: Apache-2.0
"""The stiffness schedule of a hand (Fig. 2): gripper width to pressure (linear), pressure to each stiffness.

The paper found forces and one torque to grow about linearly with pressure, and no reliable trend in other torques; a
trend is therefore only claimed where its interval excludes zero, and the band shown is as wide as the data make it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from seed_core.hand import GripperPressure
from seed_core.spatial import Array
from seed_sysid.fit.identification_fit import Solution
from seed_sysid.stiffness_map import AXES

_CONFIDENCE = 0.95  # of a slope's interval
NORMAL_95 = 1.96  # standard deviations of a normal distribution in half of that interval
_MEANINGFUL = 0.02  # relative change over the range of pressures that counts as a trend
_SAME = 1e-6  # [m] by which the widths of grips that have one width may differ
_LINEAR = 0.1  # scatter of pressure over width, as a share of its range, that still passes for a line


@dataclass(frozen=True)
class Line:
    """value = mean + slope (x - x_mean), with the slope's standard deviation and that of single values around it."""

    x_mean: float
    mean: float
    slope: float
    slope_std: float
    scatter: float
    degrees: int

    def at(self, x: Array) -> Array:
        """Values at x."""
        return np.asarray(self.mean + self.slope * (x - self.x_mean))

    @property
    def slope_interval(self) -> float:
        """Half width of the slope's 95 % interval; infinite where two points leave nothing to judge it by."""
        quantile = float(stdtrit(self.degrees, 0.5 * (1.0 + _CONFIDENCE))) if self.degrees > 0 else float("inf")
        return quantile * self.slope_std


@dataclass(frozen=True)
class StiffnessSchedule:
    """Pressure over width (None: grips of one width), and each stiffness over pressure [hPa] with whether it trends."""

    gripper: GripperPressure | None
    stiffness: tuple[Line, ...]
    trend: tuple[bool, ...]
    warnings: tuple[str, ...]


def fit_schedule(widths: Array, pressures: Array, solution: Solution) -> StiffnessSchedule | None:
    """The lines through widths [m] and pressures [hPa] of G grips (G,); None for fewer than two pressures."""
    span = float(np.ptp(pressures))
    if not span > 0.0:
        return None
    k, std = solution.value.stiffness, solution.std.stiffness
    lines = tuple(fit_line(pressures, k[:, j], std[:, j]) for j in range(6))
    trend = tuple(line.slope > max(line.slope_interval, _MEANINGFUL * abs(line.mean) / span) for line in lines)
    none = [axis for axis, has in zip(AXES, trend, strict=True) if not has]
    warnings = []
    if none:
        warnings.append(
            f"no reliable trend with pressure in {', '.join(none)} (as the paper found for some torques): "
            "values between the measured grips are uncertain by the scatter shown"
        )
    gripper = None
    if float(np.ptp(widths)) > _SAME:
        line = fit_line(widths, pressures, np.zeros_like(pressures))
        gripper = GripperPressure(line.x_mean, line.mean, -line.slope)
        if line.scatter > _LINEAR * span:
            warnings.append(f"pressure is not linear in width: it scatters by {line.scatter / span:.0%} of its range")
    else:
        warnings.append(
            f"every grip has the width {widths[0]:g} m: how pressure follows width is unknown; "
            "check that gripper/width comes"
        )
    return StiffnessSchedule(gripper, lines, trend, tuple(warnings))


def fit_line(x: Array, y: Array, y_std: Array) -> Line:
    """Least squares through (n,) points; the scatter is at least what the deviations y_std of the values explain."""
    center = x - x.mean()
    spread = float(center @ center)
    slope = float(center @ y) / spread
    residual = y - y.mean() - slope * center
    degrees = len(x) - 2
    scatter = float(np.sqrt(residual @ residual / degrees)) if degrees > 0 else 0.0
    scatter = max(scatter, float(np.sqrt(np.mean(y_std**2))))
    return Line(float(x.mean()), float(y.mean()), slope, scatter / float(np.sqrt(spread)), scatter, degrees)
