# SPDX-License-Identifier: Apache-2.0
"""What a known weight tells of a grasp: in words, as plain data, as stiffness.yaml and as a picture."""

from typing import Any

import numpy as np

from seed_core.bushing import Model
from seed_core.config import checked
from seed_core.spatial import Array
from seed_core.stiffness_file import IdentifiedGrip, StiffnessFile
from seed_sysid.fit.weight import WeightFit, loads_and_deflections
from seed_sysid.membrane.weights import WeightSlopes
from seed_sysid.report.summary import split
from seed_sysid.stiffness_map import AXES, LOAD_UNITS, UNITS

_TO_SHOWN = np.repeat([180.0 / np.pi, 1e3], 3)  # [rad, m] in degrees and mm


def split_known(values: Array) -> dict[str, list[float | None]]:
    """A six-vector as rotation and translation, None where it is not known."""
    return {half: [v if np.isfinite(v) else None for v in part] for half, part in split(values).items()}


def slope_figures(found: WeightSlopes) -> dict[str, Any]:
    """All figures of the membranes' slopes as plain data."""

    def by_axis(values: Array) -> dict[str, float | None]:
        return {a: float(v) if np.isfinite(v) else None for a, v in zip(AXES, values, strict=True)}

    return {
        "slope": by_axis(found.slope),
        "half_width": by_axis(found.half_width),
        "residual": by_axis(found.residual),
        "undetermined": found.undetermined,
        "caveats": list(found.caveats),
    }


def stiffness_lines(fit: WeightFit, truth: Array | None = None) -> list[str]:
    """A line for each axis, with its 95 % interval; truth: (6,) of a simulation."""
    lines = []
    for j, axis in enumerate(AXES):
        told = f"{fit.stiffness[j]:9.2f} +- {fit.half_width[j]:6.2f} {UNITS[j]:<8}"
        if truth is not None:
            told += f" true {truth[j]:9.2f}  error {abs(fit.stiffness[j] / truth[j] - 1):6.2%}"
        lines.append(_line(axis, told, fit.undetermined))
    return lines


def slope_lines(found: WeightSlopes) -> list[str]:
    """A line for each axis."""
    told = [
        f"{k:9.2f} +- {half:6.2f} {unit}" for k, half, unit in zip(found.slope, found.half_width, UNITS, strict=True)
    ]
    return [_line(axis, text, found.undetermined) for axis, text in zip(AXES, told, strict=True)]


def _line(axis: str, told: str, undetermined: dict[str, str]) -> str:
    why_not = undetermined.get(axis)
    return f"  {axis:<6}" + (f" not given: {why_not}" if why_not else told)


def weight_stiffness_file(
    fit: WeightFit, hand: str, tool: str, date: str, width: float, pressure: float, model: Model
) -> StiffnessFile:
    """The stiffness as the controller loads it, of one grip.

    Args:
        fit: of all six axes.
        hand: its name. tool: its name. date: ISO 8601.
        width: [m] of the gripper. pressure: [hPa], mean of both bubbles. Not a number where nobody measured it.
        model: that was fitted.

    Raises:
        ConfigError: a value is one with which the file could not be loaded.
    """
    rotation, translation, *stds = (tuple(v) for v in np.array([fit.stiffness, fit.std]).reshape(4, 3).tolist())
    grip = IdentifiedGrip(float(np.nan_to_num(pressure)), float(np.nan_to_num(width)), rotation, translation, *stds)
    return checked(StiffnessFile(hand, tool, date, (grip,), model), "stiffness.yaml")


def weight_picture(X_TC: Array, wrench: Array, fit: WeightFit, model: Model) -> str:
    """Deflection over load of each axis, an <svg> element: points by attitude (red: left out), and the line.

    Args:
        X_TC, wrench: as of `fit_weight`. fit: its result. model: of the stiffness map.
    """
    import matplotlib.pyplot as plt

    from seed_sysid.report.figures import OUTLIER, POINTS, svg

    load, xi = loads_and_deflections(X_TC, wrench, model)
    kept = np.setdiff1d(np.arange(len(load)), fit.left_out)
    figure, axes = plt.subplots(2, 3, figsize=(11, 5.6), layout="tight")
    for j, ax in enumerate(axes.flat):
        deflection = _TO_SHOWN[j] * xi[:, j]
        ax.plot(load[:, j], deflection, "o", color=OUTLIER, ms=4)
        ax.plot(load[kept, j], deflection[kept], "o", color=POINTS, ms=4)
        if np.isfinite(fit.stiffness[j]):
            ends = np.array([load[:, j].min(), load[:, j].max()])
            turned = _TO_SHOWN[j] * (ends - load[kept, j].mean()) / fit.stiffness[j]
            ax.plot(ends, deflection[kept].mean() + turned, color="0.3", lw=1)
        known = f"{fit.stiffness[j]:.4g} {UNITS[j]}" if np.isfinite(fit.stiffness[j]) else "not given"
        ax.set_title(f"{AXES[j]}: {known}", fontsize=10)
        ax.set(xlabel=f"load [{LOAD_UNITS[j]}]", ylabel="turn [deg]" if j < 3 else "shift [mm]")
    return svg(figure)
