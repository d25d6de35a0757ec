# SPDX-License-Identifier: Apache-2.0
"""The figures of the report, each as a self-contained SVG; the first redoes the paper's Fig. 2."""

import io
from collections.abc import Iterator
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from seed_core.spatial import Array
from seed_sysid.fit.analysis import Analysis
from seed_sysid.stiffness_map import AXES, CHANNELS, LOAD_UNITS, UNITS, stiffness_map

POINTS, OUTLIER = "#2f6f9f", "#c0392b"


def svg(figure: Any) -> str:
    """The figure as an <svg> element, and closed."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "seed", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _six(height: float, **options: Any) -> tuple[Any, Iterator[tuple[int, Any]]]:
    """A figure, and six numbered plots in two rows, one per axis or channel."""
    figure, axes = plt.subplots(2, 3, figsize=(11, height), layout="tight", **options)
    return figure, enumerate(axes.flat)


def stiffness_against_pressure(a: Analysis, truth: list[Array] | None = None) -> str:
    """Stiffness per axis over pressure with 95 % bars and the band of the line; hollow: the simulation's truth."""
    figure, plots = _six(5.6)
    known = bool(np.isfinite(a.pressures).all())
    x, label = (a.pressures, "pressure [hPa]") if known else (1e3 * a.widths, "width [mm]")
    for j, ax in plots:
        k, half, caveat = a.solution.value.stiffness[:, j], a.solution.half_width[:, j], ""
        if a.schedule:
            line, dense = a.schedule.stiffness[j], np.linspace(x.min(), x.max(), 20)
            y, spread = line.at(dense), line.scatter
            if not a.schedule.trend[j]:
                y, spread, caveat = np.full_like(dense, line.mean), k.std(), " (no reliable trend)"
            ax.fill_between(dense, y - 2 * spread, y + 2 * spread, color=POINTS, alpha=0.15, lw=0)
            ax.plot(dense, y, color=POINTS, lw=1)
        if truth is not None:
            ax.plot(x, [t[j] for t in truth], "o", mfc="none", mec="0.4", ms=9, label="true")
        ax.errorbar(x, k, yerr=half, fmt="o", color=POINTS, capsize=4, ms=4, label="identified")
        ax.set_title(AXES[j] + caveat, fontsize=10)
        ax.set_ylim(min(0.75 * k.mean(), min(k - half)), max(1.25 * k.mean(), max(k + half)))
        ax.set(xlabel=label, ylabel=f"stiffness [{UNITS[j]}]")
    figure.axes[0].legend(fontsize=8)
    return svg(figure)


def pressure_against_width(a: Analysis) -> str:
    """Pressure of every sample over the gripper's width, with the line."""
    figure, ax = plt.subplots(figsize=(5, 3.4))
    known = [(1e3 * s.width, float(np.mean(s.pressures))) for s in a.data.samples if s.pressures]
    if known:
        ax.plot(*np.array(known).T, ".", color=POINTS, alpha=0.5)
    if a.schedule and a.schedule.gripper:
        w = np.linspace(a.widths.min(), a.widths.max(), 10)
        ax.plot(1e3 * w, a.schedule.gripper.at_width(w), color="0.3", lw=1)
    ax.set(xlabel="gripper width [mm]", ylabel="pressure [hPa]")
    return svg(figure)


def load_against_displacement(a: Analysis) -> str:
    """Raw samples: each axis' own poses, generalised load over coordinate, bias and frame offset taken off."""
    figure, plots = _six(5.6)
    xi, load = generalised_loads(a)
    xi = xi * np.repeat([180.0 / np.pi, 1e3], 3)  # to [deg], [mm]
    stiffness = a.solution.value.stiffness / np.repeat([180.0 / np.pi, 1e3], 3)
    kinds, labels = np.array([s.kind for s in a.data.samples]), ("rotation [deg]",) * 3 + ("displacement [mm]",) * 3
    for j, ax in plots:
        own = (kinds == AXES[j]) | (kinds == "home")
        for g in range(len(a.grips)):
            mine = own & (a.problem.grip == g)
            good = mine & a.solution.inlier
            ax.plot(xi[good, j], load[good, j], ".", ms=5, label=f"{1e3 * a.widths[g]:.0f} mm")
            ends = np.array([xi[mine, j].min(), xi[mine, j].max()]) if mine.any() else np.zeros(2)
            ax.plot(ends, stiffness[g, j] * ends, color="0.6", lw=0.7, zorder=0)
        bad = own & ~a.solution.inlier
        ax.plot(xi[bad, j], load[bad, j], "x", color=OUTLIER)
        ax.set_title(AXES[j] + (" (hysteretic)" if AXES[j] in a.hysteretic else ""), fontsize=10)
        ax.set(xlabel=labels[j], ylabel=f"{'force' if j >= 3 else 'torque'} [{LOAD_UNITS[j]}]")
    figure.axes[0].legend(fontsize=8, title="width")
    return svg(figure)


def generalised_loads(a: Analysis) -> tuple[Array, Array]:
    """Coordinates xi (n, 6), and the measured generalised loads (n, 6): model plus residual, per axis."""
    problem, found = a.problem, a.solution.value
    B, xi = stiffness_map(problem.X_TC, problem.parameters.model)
    residual = np.linalg.solve(B, -a.solution.residuals[:, :, None])[:, :, 0]
    return xi, found.stiffness[problem.grip] * xi + found.friction * problem.z + residual


def residuals(a: Analysis) -> str:
    """Residual of each channel over the run; crosses are outliers."""
    figure, plots = _six(4.6, sharex=True)
    good, noise = a.solution.inlier, a.solution.noise
    minutes = (a.problem.time - a.problem.time[0]) / 60.0
    for j, ax in plots:
        r = a.solution.residuals[:, j]
        ax.plot(minutes[good], r[good], ".", color=POINTS, ms=3)
        ax.plot(minutes[~good], np.clip(r[~good], -5.0 * noise[j], 5.0 * noise[j]), "x", color=OUTLIER)
        figures = f"{noise[j]:.2g} {LOAD_UNITS[j]}, R² {a.solution.r_squared[j]:.5f}"
        ax.set_title(f"{CHANNELS[j]}: {figures}", fontsize=9)
        ax.set(ylabel=f"residual [{LOAD_UNITS[j]}]", xlabel="time [min]" if j >= 3 else "")
    return svg(figure)


def couplings(a: Analysis) -> str:
    """Full symmetric fit: coupling of each pair of axes, -1 to 1."""
    figure, ax = plt.subplots(figsize=(4.4, 3.8))
    c = a.assumption.coupling
    image = ax.imshow(c, cmap="RdBu", vmin=-0.2, vmax=0.2)
    for i, j in zip(*np.nonzero(~np.eye(6, dtype=bool)), strict=True):
        ax.text(j, i, f"{c[i, j]:+.2f}", ha="center", va="center", fontsize=7)
    ax.set_xticks(range(6), AXES)
    ax.set_yticks(range(6), AXES)
    figure.colorbar(image, ax=ax, shrink=0.8)
    return svg(figure)
