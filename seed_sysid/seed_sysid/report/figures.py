# SPDX-License-Identifier: Apache-2.0
"""The figures of the report, each as a self-contained SVG; the first redoes the paper's Fig. 2."""

from __future__ import annotations

import io
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from seed_core.spatial import Array
from seed_sysid.fit.analysis import Analysis
from seed_sysid.fit.identification_fit import Problem
from seed_sysid.stiffness_map import AXES, CHANNELS, LOAD_UNITS, UNITS, stiffness_map

_POINTS, _OUTLIER = "#2f6f9f", "#c0392b"


def svg(figure: Any) -> str:
    """The figure as an <svg> element, and closed."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "seed", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def stiffness_against_pressure(a: Analysis, truth: list[Array] | None = None) -> str:
    """Stiffness per axis over pressure with 95 % bars and the band of the line; hollow: the simulation's truth."""
    figure, axes = plt.subplots(2, 3, figsize=(11, 5.6))
    x, known = (a.pressures, True) if np.isfinite(a.pressures).all() else (1e3 * a.widths, False)
    for j, ax in enumerate(axes.flat):
        k, half = a.solution.stiffness[:, j], a.solution.stiffness_half_width[:, j]
        if a.grip_model and known:
            _band(ax, a, j)
        if truth is not None:
            ax.plot(x, [t[j] for t in truth], "o", mfc="none", mec="0.4", ms=9, label="true")
        ax.errorbar(x, k, yerr=half, fmt="o", color=_POINTS, capsize=4, ms=4, label="identified")
        ax.set_title(AXES[j] + _caveat(a, j), fontsize=10)
        ax.set_ylabel(f"stiffness [{UNITS[j]}]")
        low, high = min(k - half), max(k + half)
        ax.set_ylim(min(0.75 * k.mean(), low), max(1.25 * k.mean(), high))
        ax.set_xlabel("pressure [hPa]" if known else "width [mm]")
    axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    return svg(figure)


def _band(ax: Any, a: Analysis, j: int) -> None:
    assert a.grip_model is not None
    line = a.grip_model.stiffness[j]
    x = np.linspace(a.pressures.min(), a.pressures.max(), 20)
    y = line.at(x) if a.grip_model.trend[j] else np.full_like(x, line.mean)
    spread = a.solution.stiffness[:, j].std() if not a.grip_model.trend[j] else line.scatter
    ax.fill_between(x, y - 2 * spread, y + 2 * spread, color=_POINTS, alpha=0.15, lw=0)
    ax.plot(x, y, color=_POINTS, lw=1)


def _caveat(a: Analysis, j: int) -> str:
    if a.grip_model is None or a.grip_model.trend[j]:
        return ""
    return " (no reliable trend)"


def pressure_against_width(a: Analysis) -> str:
    """Pressure of every sample over the gripper's width, with the line."""
    figure, ax = plt.subplots(figsize=(5, 3.4))
    known = [(1e3 * s.width, float(np.mean(s.pressures))) for s in a.data.samples if s.pressures]
    if known:
        ax.plot(*np.array(known).T, ".", color=_POINTS, alpha=0.5)
    if a.grip_model:
        w = np.linspace(a.widths.min(), a.widths.max(), 10)
        ax.plot(1e3 * w, a.grip_model.pressure.at(w), color="0.3", lw=1)
    ax.set_xlabel("gripper width [mm]")
    ax.set_ylabel("pressure [hPa]")
    return svg(figure)


def load_against_displacement(a: Analysis) -> str:
    """Raw samples: each axis' own poses, generalised load over coordinate, bias and frame offset taken off."""
    figure, axes = plt.subplots(2, 3, figsize=(11, 5.6))
    xi, load = generalised_loads(a)
    kinds = np.array([s.kind for s in a.data.samples])
    for j, ax in enumerate(axes.flat):
        unit = 1e3 if j >= 3 else 180 / np.pi
        for g in range(len(a.grips)):
            mine = (a.problem.grip == g) & ((kinds == AXES[j]) | (kinds == "home"))
            good = mine & a.solution.inlier
            ax.plot(unit * xi[good, j], load[good, j], ".", ms=5, label=f"{1e3 * a.widths[g]:.0f} mm")
            ends = np.array([xi[mine, j].min(), xi[mine, j].max()]) if mine.any() else np.zeros(2)
            ax.plot(unit * ends, a.solution.stiffness[g, j] * ends, color="0.6", lw=0.7, zorder=0)
        bad = ((kinds == AXES[j]) | (kinds == "home")) & ~a.solution.inlier
        ax.plot(unit * xi[bad, j], load[bad, j], "x", color=_OUTLIER)
        ax.set_title(AXES[j] + (" (hysteretic)" if AXES[j] in a.hysteretic else ""), fontsize=10)
        ax.set_xlabel("displacement [mm]" if j >= 3 else "rotation [deg]")
        ax.set_ylabel("force [N]" if j >= 3 else "torque [N m]")
    axes[0, 0].legend(fontsize=8, title="width")
    figure.tight_layout()
    return svg(figure)


def generalised_loads(a: Analysis) -> tuple[Array, Array]:
    """Coordinates xi (n, 6), and the measured generalised loads (n, 6): model plus residual, per axis."""
    problem: Problem = a.problem
    m = stiffness_map(problem.X_TC, problem.parameters.model)
    model = a.solution.stiffness[problem.grip] * m.xi
    if problem.z is not None:
        model = model + a.solution.friction * problem.z
    residual = np.linalg.solve(m.B, -a.solution.residuals[:, :, None])[:, :, 0]
    return m.xi, model + residual


def residuals(a: Analysis) -> str:
    """Residual of each channel over the run; crosses are outliers."""
    figure, axes = plt.subplots(2, 3, figsize=(11, 4.6), sharex=True)
    good = a.solution.inlier
    minutes = (a.problem.time - a.problem.time[0]) / 60.0
    for j, ax in enumerate(axes.flat):
        r = a.solution.residuals[:, j]
        ax.plot(minutes[good], r[good], ".", color=_POINTS, ms=3)
        limit = 5.0 * a.solution.noise[j]
        ax.plot(minutes[~good], np.clip(r[~good], -limit, limit), "x", color=_OUTLIER)
        ax.set_title(
            f"{CHANNELS[j]}: {a.solution.noise[j]:.2g} {LOAD_UNITS[j]}, R² {a.solution.r_squared[j]:.5f}", fontsize=9
        )
        ax.set_ylabel(f"residual [{LOAD_UNITS[j]}]")
    for ax in axes[1]:
        ax.set_xlabel("time [min]")
    figure.tight_layout()
    return svg(figure)


def couplings(a: Analysis) -> str:
    """Full symmetric fit: coupling of each pair of axes, -1 to 1."""
    figure, ax = plt.subplots(figsize=(4.4, 3.8))
    c = a.assumption.coupling
    image = ax.imshow(c, cmap="RdBu", vmin=-0.2, vmax=0.2)
    for i in range(6):
        for j in range(6):
            if i != j:
                ax.text(j, i, f"{c[i, j]:+.2f}", ha="center", va="center", fontsize=7)
    ax.set_xticks(range(6), AXES)
    ax.set_yticks(range(6), AXES)
    figure.colorbar(image, ax=ax, shrink=0.8)
    return svg(figure)
