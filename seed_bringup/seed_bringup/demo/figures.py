# SPDX-License-Identifier: Apache-2.0
"""The figures of a run as SVG text, drawn with Matplotlib."""

import io
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from seed_bringup.demo.score import BAND, BeliefCurves, Curve, Phase
from seed_bringup.demo.series import Series
from seed_core.spatial import Array, rpy_from_rotation
from seed_sim.closed_loop.recording import Recording
from seed_sim.replay.plots import NAMED, draw_path

BLUE, ORANGE, GREEN, GREY, INK = "#1f6feb", "#e8710a", "#188a5b", "#9aa4b2", "#1f2937"
AXES = (("x", "mm"), ("y", "mm"), ("z", "mm"), ("roll", "deg"), ("pitch", "deg"), ("yaw", "deg"))
STYLE = Path(__file__).parents[1] / "templates" / "figures.mplstyle"


def force_and_torque(
    runs: Mapping[str, Curve], wanted_force: float, scored: list[tuple[float, float]], phases: list[Phase]
) -> str:
    """Pressing force [N] and torque about x of the tool, at its tip [N m], over time, by name of the run.

    The first run is drawn in colour, the others as what it is compared with. scored: the shaded stretches [s].
    """
    with style.context(STYLE):
        figure = Figure(figsize=(9.6, 5.2), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True)
        colours = [BLUE, ORANGE, GREY, GREEN]
        for i, (name, run) in reversed(list(enumerate(runs.items()))):
            width, order = (1.8, 5) if i == 0 else (1.1, 2)
            top.plot(run.t, run.force, color=colours[i % 4], lw=width, zorder=order, label=name)
            bottom.plot(run.t, run.torque, color=colours[i % 4], lw=width, zorder=order, label=name)
        t = next(iter(runs.values())).t
        end = scored[-1][1] if scored else float(t[-1])
        top.annotate(
            f"wanted {wanted_force:g} N", (end, wanted_force), xytext=(4, 4), textcoords="offset points", color=INK
        )
        for axis, wanted, label in ((top, wanted_force, "pressing force [N]"), (bottom, 0.0, "torque [N m]")):
            axis.axhline(wanted, color=INK, lw=1.0, ls=(0, (4, 3)), zorder=6)
            axis.set_ylabel(label)
            _shade(axis, scored)
        top.set_ylim(min(-0.08 * wanted_force, -0.5), 1.6 * wanted_force)
        _name_phases(top, phases)
        handles, labels = top.get_legend_handles_labels()
        bottom.legend(handles[::-1], labels[::-1], loc="upper left", ncols=4, fontsize=9)
        bottom.set_xlabel("time [s]")
        top.set_xlim(float(t[0]), float(t[-1]))
        torques = [np.abs(run.torque[_within(run.t, scored)]) for run in runs.values()]
        worst = max([0.1, *(float(np.percentile(q, 99, method="nearest")) for q in torques if q.size)])
        bottom.set_ylim(-1.3 * worst, 1.6 * worst)
        return svg(figure)


def path_on_table(recording: Recording, phase: str) -> str:
    """Where the tip was to go and went, seen along the work frame's z [mm]; colour tells the pressing force [N]."""
    tip = 1e3 * recording["tip"]
    with style.context(STYLE):
        width, height = (max(float(np.ptp(tip[:, i])), 20.0) for i in (0, 1))
        figure = Figure(figsize=(9.6, float(np.clip(8.0 * height / width, 2.2, 6.0))), layout="constrained")
        draw_path(figure.subplots(), recording, phase)
        return svg(figure)


def true_and_believed(run: BeliefCurves, scored: list[tuple[float, float]], phases: list[Phase]) -> str:
    """True, believed and wanted pressing force [N] over time, and below what truth and belief differ by.

    The band is of BAND stated deviations either way. scored: the shaded stretches [s].
    """
    with style.context(STYLE):
        figure = Figure(figsize=(9.6, 5.6), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        wide = BAND * run.deviation
        label = f"believed, with {BAND:g} stated deviations"
        top.fill_between(run.t, run.believed - wide, run.believed + wide, color=ORANGE, alpha=0.22, lw=0, zorder=2)
        top.plot(run.t, run.wanted, color=INK, lw=1.0, ls=(0, (4, 3)), zorder=3, label="wanted")
        top.plot(run.t, run.believed, color=ORANGE, lw=1.2, zorder=4, label=label)
        top.plot(run.t, run.true, color=BLUE, lw=1.6, zorder=5, label="true, of the simulated contact")
        bottom.fill_between(run.t, -wide, wide, color=ORANGE, alpha=0.22, lw=0, zorder=2)
        bottom.plot(run.t, run.true - run.believed, color=BLUE, lw=1.2, zorder=4)
        bottom.axhline(0.0, color=ORANGE, lw=1.0, zorder=3)
        size = max(float(np.abs(run.wanted).max()), 0.5)
        top.set_ylim(-0.12 * size, 1.6 * size)
        inside = _within(run.t, scored)
        both = np.concatenate([np.abs(run.true - run.believed)[inside], wide[inside]])
        most = float(np.percentile(both, 99)) if both.size else 0.1 * size
        bottom.set_ylim(-1.5 * most - 0.05, 1.5 * most + 0.05)
        for axis, name in ((top, "pressing force [N]"), (bottom, "true - believed [N]")):
            axis.set_ylabel(name)
            _shade(axis, scored)
        _name_phases(top, phases)
        top.legend(loc="upper left", fontsize=9)
        bottom.set_xlabel("time [s]")
        bottom.set_xlim(float(run.t[0]), float(run.t[-1]))
        return svg(figure)


def relative_pose(estimate: Series, truth: Series, phases: list[Phase]) -> str:
    """The six coordinates of X_CT: as estimated, and as they are."""
    with style.context(STYLE):
        figure = Figure(figsize=(9.6, 4.6), layout="constrained")
        grid = figure.subplots(2, 3, sharex=True)
        estimated, true = _coordinates(estimate.values), _coordinates(truth.values)
        for i, (axis, (name, unit)) in enumerate(zip(grid.flat, AXES, strict=True)):
            axis.plot(truth.t, true[:, i], color=GREY, lw=2.6, label="truth", zorder=2)
            axis.plot(estimate.t, estimated[:, i], color=BLUE, lw=1.1, label="estimate", zorder=3)
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


def _coordinates(poses: Array) -> Array:
    """(N, 6) x, y, z [mm], roll, pitch, yaw [deg] of poses (N, 4, 4)."""
    rpy = np.array([rpy_from_rotation(X[:3, :3]) for X in poses])
    return np.hstack([1e3 * poses[:, :3, 3], np.rad2deg(rpy)])


def _within(t: Array, stretches: list[tuple[float, float]]) -> NDArray[np.bool_]:
    """Mask (n,) of the times (n,) that lie in one of the stretches."""
    return np.array([any(start <= s <= end for start, end in stretches) for s in t], bool)


def _shade(axis: Axes, stretches: list[tuple[float, float]]) -> None:
    for start, end in stretches:
        axis.axvspan(start, end, color=BLUE, alpha=0.06, lw=0)


def _name_phases(axis: Axes, phases: list[Phase]) -> None:
    """Where each phase begins, and its name; nothing of a drawing with many strokes."""
    if len(phases) > NAMED:
        return
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
    text = re.sub(r'(id="|xlink:href="#|url\(#)', rf"\g<1>{mark}", text)
    return re.sub(r'<svg([^>]*) width="[^"]*"', r"<svg\1", re.sub(r' height="[\d.]+pt"', "", text, count=1), count=1)
