# SPDX-License-Identifier: Apache-2.0
"""Stiffness without a force sensor: a calibrated weight, held in a few orientations.

At rest the spring carries the weight: w = -(com x m g, m g) about T, in T. With w = B (K xi) each axis is a line
through its own numbers, xi_j = (B^-1 w)_j / k_j + xi0_j; xi0 is how the grasp sat at its reference. An axis gets a
stiffness only where the weight loads it: a weight whose centre of mass lies at T gives the forces alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from seed_core.bushing import Model
from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_sysid.fit.stiffness_schedule import NORMAL_95, Line, fit_line
from seed_sysid.stiffness_map import AXES, LOAD_UNITS, stiffness_map

ORIENTATIONS_DEG = ((0, 0), (90, 0), (-90, 0), (180, 0), (0, 90), (0, -90), (45, 0), (0, 45), (-135, 0), (0, -135))
"""Roll and pitch of the hand that load every axis; any other orientations do as well."""
_UNCERTAIN = 0.10  # relative scatter of a line's slope above which an axis is not given
LOADED = (1e-3,) * 3 + (0.05,) * 3  # [N m, N]; an axis whose load varies by less is not loaded
MINIMUM = 4  # orientations
_STRAY, _MOST_LEFT_OUT = 6.0, 0.3  # deviations off the line through the others; share of the orientations
_ALONE = 0.95  # leverage, from which on a line goes through an orientation whatever it tells
_NOISE = (np.deg2rad(0.05),) * 3 + (3e-5,) * 3  # [rad, m] that a mean pose is off by, at least
_BENT = 0.05  # of the range of deflections, by which a spring that stiffens is off its line


class WeightError(SeedError):
    """Data of a held weight that give no stiffness."""


@dataclass(frozen=True)
class WeightFit:
    """Stiffness by a weight.

    Attributes:
        stiffness: (6,) [N m/rad, N/m], nan where the weight cannot tell. half_width: (6,) of the 95 % interval, by
            Student's t: few orientations tell little of the noise.
        undetermined: by axis why the weight cannot tell.
        left_out: indices of the orientations that do not go with the others: something else loaded the tool, or
            carried it.
    """

    stiffness: Array
    half_width: Array
    undetermined: dict[str, str]
    left_out: tuple[int, ...] = ()

    @property
    def std(self) -> Array:
        """(6,) [N m/rad, N/m], with which a normal distribution has the same 95 % interval."""
        return np.asarray(self.half_width / NORMAL_95)


def fit_weight(X_TC: ArrayLike, wrench: ArrayLike, model: Model = "midpoint") -> WeightFit:
    """The stiffness of a grasp that holds a known weight.

    Args:
        X_TC: (n, 4, 4) displacements, one for each orientation.
        wrench: (n, 6) [N m, N] of the spring on the tool about T, in T: minus seed_core.hand.weight_about_T.
        model: the stiffness map.

    Returns:
        The stiffness of the axes that the weight loads, and why it cannot tell the others.

    Raises:
        WeightError: too few orientations, or no axis is loaded.
    """
    poses = np.asarray(X_TC, dtype=float)
    if len(poses) < MINIMUM:
        raise WeightError(f"{len(poses)} orientations are too few: hold the weight in at least {MINIMUM}")
    load, xi = loads_and_deflections(poses, np.asarray(wrench, dtype=float), model)
    left_out = _strays(load, xi)
    kept = np.setdiff1d(np.arange(len(load)), left_out)
    out, load, xi = load[list(left_out)], load[kept], xi[kept]
    stiffness, half, reasons = np.full(6, np.nan), np.full(6, np.nan), {}
    for j, axis in enumerate(AXES):
        span, unit = float(np.ptp(load[:, j])), LOAD_UNITS[j]
        if span < LOADED[j]:
            kind = "torque" if j < 3 else "force"
            reasons[axis] = f"the weight puts no {kind} on it (at most {span:.2g} {unit})"
            continue
        off = load[:, j] - load[:, j].mean()
        leverage = 1.0 / len(off) + float((off**2).max() / (off @ off))
        if leverage > _ALONE and (np.abs(out[:, j] - load[:, j].mean()) >= LOADED[j]).any():
            reasons[axis] = (
                "one orientation alone loads it besides those that were left out, and which of them is right nobody "
                "knows: hold the weight in more"
            )
            continue
        compliance = compliance_line(load[:, j], xi[:, j], _NOISE[j])
        if compliance is None:
            reasons[axis] = f"its load varies by {span:.2g} {unit} only: too little for the noise of the poses"
            continue
        stiffness[j], half[j] = 1.0 / compliance.slope, compliance.slope_interval / compliance.slope**2
    if len(reasons) == 6:
        raise WeightError("the weight determines no axis: use a heavier one and turn the hand further")
    return WeightFit(stiffness, half, reasons, left_out)


def loads_and_deflections(X_TC: Array, wrench: Array, model: Model) -> tuple[Array, Array]:
    """(n, 6) generalised loads [N m, N] and displacements [rad, m] of each axis; arguments as of `fit_weight`."""
    B, xi = stiffness_map(X_TC, model)
    return np.asarray(np.linalg.solve(B, wrench[:, :, None])[:, :, 0], dtype=float), xi


def _strays(load: Array, xi: Array) -> tuple[int, ...]:
    """Orientations (of at most 30 %) that are far from the lines through all others, the furthest first."""
    kept, out = list(range(len(load))), list[int]()
    while len(out) + 1 <= _MOST_LEFT_OUT * len(load) and len(kept) > MINIMUM:
        off = [_off(load[k], xi[k], np.delete(load[kept], i, axis=0), np.delete(xi[kept], i, axis=0))
               for i, k in enumerate(kept)]  # fmt: skip
        worst = int(np.argmax(off))
        if off[worst] < _STRAY:
            break
        out.append(kept.pop(worst))
    return tuple(out)


def _off(load: Array, xi: Array, loads: Array, others: Array) -> float:
    """By how many deviations an orientation (6,) lies off the line through others (n, 6), on its worst loaded axis."""
    worst = 0.0
    for j in np.flatnonzero(np.ptp(loads, axis=0) >= LOADED):
        line = fit_line(loads[:, j], others[:, j], np.zeros(len(loads)))
        scatter = max(line.scatter, _NOISE[j], _BENT * float(np.ptp(others[:, j])))
        variance = scatter**2 * (1.0 + 1.0 / len(loads)) + ((load[j] - line.x_mean) * line.slope_std) ** 2
        worst = max(worst, abs(float(xi[j] - line.at(load[j]))) / float(np.sqrt(variance)))
    return worst


def compliance_line(load: Array, deflection: Array, noise: float = 0.0) -> Line | None:
    """The line of deflections (n,), of at least this noise, over known loads (n,); None where noise hides its slope, or
    it falls."""
    line = fit_line(load, deflection, np.full(len(load), noise))
    return line if line.slope > 0.0 and line.slope_std <= _UNCERTAIN * line.slope else None
