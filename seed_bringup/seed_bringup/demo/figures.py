# SPDX-License-Identifier: Apache-2.0
"""The figures of a run as SVG text, drawn with Matplotlib."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from seed_bringup.demo.series import Array, Series, axes_of

BLUE, ORANGE, GREEN, GREY, INK = "#1f6feb", "#e8710a", "#188a5b", "#9aa4b2", "#1f2937"
AXES = (("x", "mm"), ("y", "mm"), ("z", "mm"), ("roll", "deg"), ("pitch", "deg"), ("yaw", "deg"))
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "grid.color": "#e7eaf0",
    "grid.linewidth": 0.8,
    "xtick.color": "#5b6573",
    "ytick.color": "#5b6573",
    "legend.frameon": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "seed",
}


@dataclass(frozen=True)
class Phase:
    """A named stretch of time [s]."""

    name: str
    start: float
    end: float


def force_and_torque(
    runs: Mapping[str, tuple[Array, Array, Array]], wanted_force: float, band: tuple[float, float], phases: list[Phase]
) -> str:
    """Pressing force [N] and torque about the blade's centre [N m] over time; runs: name -> (t, force, torque).

    The first run is drawn in colour, the others as what it is compared with. band: the scored stretch [s].
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 5.2), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True)
        colours = [BLUE, ORANGE, GREY, GREEN]
        for i, (name, (t, force, torque)) in reversed(list(enumerate(runs.items()))):
            width, order = (1.8, 5) if i == 0 else (1.1, 2)
            top.plot(t, force, color=colours[i % 4], lw=width, zorder=order, label=name)
            bottom.plot(t, torque, color=colours[i % 4], lw=width, zorder=order, label=name)
        top.axhline(wanted_force, color=INK, lw=1.0, ls=(0, (4, 3)), zorder=6)
        top.annotate(
            f"wanted {wanted_force:g} N", (band[1], wanted_force), xytext=(4, 4), textcoords="offset points", color=INK
        )
        bottom.axhline(0.0, color=INK, lw=1.0, ls=(0, (4, 3)), zorder=6)
        for axis, label in ((top, "pressing force [N]"), (bottom, "torque [N m]")):
            axis.set_ylabel(label)
            axis.axvspan(*band, color=BLUE, alpha=0.06, lw=0)
        top.set_ylim(min(-0.08 * wanted_force, -0.5), 1.6 * wanted_force)
        _name_phases(top, phases)
        handles, labels = top.get_legend_handles_labels()
        bottom.legend(handles[::-1], labels[::-1], loc="upper left", ncols=4, fontsize=9)
        bottom.set_xlabel("time [s]")
        first = next(iter(runs.values()))[0]
        top.set_xlim(float(first[0]), float(first[-1]))
        worst = max(0.1, *(float(np.percentile(np.abs(q[(t >= band[0]) & (t <= band[1])]), 99, method="nearest"))
                           for t, _, q in runs.values() if ((t >= band[0]) & (t <= band[1])).any()))  # fmt: skip
        bottom.set_ylim(-1.3 * worst, 1.6 * worst)
        return svg(figure)


def relative_pose(estimate: Series, truth: Series, phases: list[Phase]) -> str:
    """The six coordinates of X_CT: as estimated from the images, and as they are."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.6), layout="constrained")
        grid = figure.subplots(2, 3, sharex=True)
        estimated, true = axes_of(estimate.values), axes_of(truth.values)
        for i, (name, unit) in enumerate(AXES):
            axis = grid[i // 3][i % 3]
            axis.plot(truth.t, true[:, i], color=GREY, lw=2.6, label="truth", zorder=2)
            axis.plot(estimate.t, estimated[:, i], color=BLUE, lw=1.1, label="from images", zorder=3)
            axis.set_title(f"{name} [{unit}]", fontsize=10, loc="left", color=INK)
            span = max(float(np.ptp(true[:, i])), 0.5)
            middle = 0.5 * float(true[:, i].max() + true[:, i].min())
            axis.set_ylim(middle - 0.75 * span, middle + 0.75 * span)
        grid[0][0].legend(loc="best", fontsize=9)
        for axis in grid[1]:
            axis.set_xlabel("time [s]")
        if phases:
            grid[0][0].set_xlim(phases[0].start, phases[-1].end)
        return svg(figure)


def _name_phases(axis: Axes, phases: list[Phase]) -> None:
    for phase in phases:
        axis.axvline(phase.start, color=GREY, lw=0.8, ls=(0, (1, 3)), zorder=1)
        if phase.end - phase.start > 0.4:
            axis.text(
                0.5 * (phase.start + phase.end), 1.01, phase.name, transform=axis.get_xaxis_transform(), ha="center",
                va="bottom", fontsize=8.5, color="#5b6573",
            )  # fmt: skip


def svg(figure: Figure) -> str:
    """The figure as an <svg> element whose identifiers meet those of no other figure in the page."""
    out = io.StringIO()
    figure.savefig(out, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    text = text[text.index("<svg") :]
    mark = f"f{abs(hash(text)) % 10**8}-"
    text = re.sub(r'id="', f'id="{mark}', text)
    text = re.sub(r'(xlink:href="#|url\(#)', lambda m: m.group(1) + mark, text)
    return re.sub(r'<svg([^>]*) width="[^"]*"', r"<svg\1", re.sub(r' height="[\d.]+pt"', "", text, count=1), count=1)
