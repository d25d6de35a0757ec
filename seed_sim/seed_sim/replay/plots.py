# SPDX-License-Identifier: Apache-2.0
"""What one run did, as curves: the tip's path seen from above, and force, torque and lean over time."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import blended_transform_factory

from seed_core.program.files import named_in_errors
from seed_sim.closed_loop.recording import Recording

BLUE, GREY, INK = "#1f6feb", "#9aa4b2", "#1f2937"
DASHES = (0, (4, 3))
TOUCH = 0.3  # [N] from which the tip is drawn as touching
NAMED, ROOM = 8, 0.05  # most phases whose names are drawn, and the share of the run that each name needs


def save(figure: Figure, file: Path, dpi: int) -> None:
    """Write a picture. Raises OSError."""
    with named_in_errors(file):
        figure.savefig(file, dpi=dpi)


def draw_path(axis: Axes, recording: Recording, phase: str) -> None:
    """Where the tip was to go and went, seen along the work frame's z [mm]; colour tells the pressing force [N].

    phase: the one that is scored; its forces set the range of the colours.
    """
    tip, wanted, force = 1e3 * recording["tip"], 1e3 * recording["reference"], -recording["force"][:, 2]
    touching = np.linalg.norm(recording["force"], axis=1) > TOUCH
    scored = recording.scored(phase)
    pressed = np.array(force[scored & touching]) if (scored & touching).any() else np.array((0.0, 1.0))
    middle, span = float(np.median(pressed)), max(float(np.ptp(np.percentile(pressed, (1, 99)))), 0.4)
    axis.plot(*wanted[:, :2].T, color=INK, lw=1.0, ls=DASHES, label="wanted", zorder=2)
    axis.plot(*np.where(touching[:, None], np.nan, tip)[:, :2].T, color=GREY, lw=1.0, label="in the air", zorder=3)
    dots = axis.scatter(
        *tip[touching][:, :2].T, c=force[touching], s=9.0, cmap="viridis", zorder=4,
        vmin=middle - 0.5 * span, vmax=middle + 0.5 * span,
    )  # fmt: skip
    axis.figure.colorbar(dots, ax=axis, label="pressing force [N]", shrink=0.9)
    axis.set_aspect("equal", "datalim")
    axis.margins(0.08)
    axis.set(xlabel="x of the work frame [mm]", ylabel="y [mm]")
    axis.legend(loc="upper left", fontsize=9)


def run_figure(recording: Recording, phase: str, title: str) -> Figure:
    """The path beside the true pressing force [N], and below it torque [N m] where the task has one, or lean [deg].

    phase: the one that is scored; its stretch is shaded.
    """
    figure = Figure(figsize=(12.0, 5.6), layout="constrained")
    figure.suptitle(title, color=INK)
    path, curves = figure.subfigures(1, 2, width_ratios=(5, 6))
    draw_path(path.subplots(), recording, phase)
    t = recording["t"]
    force, below = curves.subplots(2, 1, sharex=True)
    force.plot(t, -recording["force"][:, 2], color=BLUE, lw=1.4, label="true")
    force.plot(t, -recording["wanted_force"][:, 2], color=INK, lw=1.0, ls=DASHES, label="wanted")
    force.set_ylabel("pressing force [N]")
    force.legend(loc="center", fontsize=9)
    turned = [i for i in range(3) if recording.torque_axes[i]]
    if turned:
        below.plot(t, recording["torque_T"][:, turned[0]], color=BLUE, lw=1.4)
        below.plot(t, recording["wanted_torque_T"][:, turned[0]], color=INK, lw=1.0, ls=DASHES)
        below.set_ylabel(f"torque about the tool's {'xyz'[turned[0]]} [N m]")
    else:
        below.plot(t, np.rad2deg(np.linalg.norm(recording["lean"], axis=1)), color=BLUE, lw=1.4)
        below.set_ylabel("lean [deg]")
    below.set_xlabel("time [s]; shaded: what is scored")
    scored = recording.scored(phase)
    for axis in (force, below):
        axis.grid(color="#e7eaf0", lw=0.8)
        axis.fill_between(t, 0, 1, where=scored, transform=axis.get_xaxis_transform(), color=BLUE, alpha=0.06, lw=0)
    _name_phases(force, recording)
    return figure


def _name_phases(axis: Axes, recording: Recording) -> None:
    """Where each phase begins, and its name where there is room for it; nothing of a drawing with many strokes."""
    t, index = recording["t"], recording["phase"]
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    if len(starts) > NAMED:
        return
    above = blended_transform_factory(axis.transData, axis.transAxes)
    last = -np.inf
    for start in starts:
        axis.axvline(t[start], color=GREY, lw=0.8, ls=(0, (1, 3)), zorder=1)
        if t[start] - last < ROOM * (t[-1] - t[0]):
            continue
        last = t[start]
        name = recording.phases[index[start]]
        axis.text(t[start], 1.02, name, transform=above, fontsize=8.5, color="#5b6573", rotation=20, va="bottom")
