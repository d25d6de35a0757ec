# SPDX-License-Identifier: Apache-2.0
"""An insertion by touch: where the tip went over the plate, how deep it is, and what it bore, over time."""

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from seed_bringup.demo.figures import BLUE, GREY, INK, ORANGE, STYLE
from seed_bringup.pictures.scene import png
from seed_control.tasks import load_task
from seed_core.spatial import Array, inverse_pose
from seed_sim import evaluate
from seed_sim.closed_loop.evaluate import Evaluation

TASK, SEED = "insert_peg", 1
BEFORE = 0.3  # [s] of the way to the plate that are shown
SLACK = 1e-3  # [m] off the hole's axis within which both chamfers lead the peg in


def inserts() -> bytes:
    """One run with noise and delay."""
    run = evaluate(TASK, estimator="noisy", seed=SEED)
    with style.context(STYLE):
        figure = Figure(figsize=(9.6, 4.2), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.25))
        _over_the_plate(left.subplots(), run)
        top, bottom = right.subplots(2, 1, sharex=True)
        _over_time(top, bottom, run)
        return png(figure)


def _in_hole(run: Evaluation) -> Array:
    """The tip (n, 3) [mm] in the hole's frame."""
    hole, X_work = run.plant.hole, load_task(TASK).frame.pose
    assert hole is not None
    X = inverse_pose(hole.X_WH) @ X_work
    return np.asarray(1e3 * (run.recording["tip"] @ X[:3, :3].T + X[:3, 3]))


def _over_the_plate(axes: Axes, run: Evaluation) -> None:
    tip, phase = _in_hole(run), run.recording["phase"]
    for name, colour in (("touch", GREY), ("search", BLUE), ("insert", ORANGE)):
        on = phase == run.recording.phases.index(name)
        axes.plot(*tip[on, :2].T, color=colour, lw=1.6, label=name)
    axes.add_patch(Circle((0.0, 0.0), 1e3 * SLACK, fill=False, color=INK, lw=1.0, ls="--"))
    axes.annotate("the chamfers lead in", (0.0, -1.05e3 * SLACK), ha="center", va="top", color=INK, fontsize=8)
    axes.set(xlabel="tip over the plate, x [mm]", ylabel="y [mm]", aspect="equal")
    axes.margins(0.15)
    axes.legend(loc="best", fontsize=8)


def _over_time(top: Axes, bottom: Axes, run: Evaluation) -> None:
    recording, tip = run.recording, _in_hole(run)
    first, last = recording.phases.index("touch"), recording.phases.index("insert")
    contact = recording.contact_time
    assert contact is not None
    on = (recording["phase"] >= first) & (recording["phase"] <= last) & (recording["t"] > contact - BEFORE)
    t, force = recording["t"][on], recording["force"][on]
    top.plot(t, -tip[on, 2], color=BLUE)
    top.set(ylabel="depth [mm]", ylim=(-5.0, None))
    bottom.plot(t, -force[:, 2], color=BLUE, label="along the press")
    bottom.plot(t, np.hypot(force[:, 0], force[:, 1]), color=ORANGE, label="sideways")
    bottom.set(xlabel="time [s]", ylabel="force [N]", ylim=(None, 1.3 * float(np.abs(force).max())))
    bottom.legend(loc="upper right", ncols=2, fontsize=8)
    for i in sorted(set(recording["phase"][on].tolist())):
        start = max(float(recording["t"][recording["phase"] == i][0]), float(t[0]))
        for axes in (top, bottom):
            axes.axvline(start, color=GREY, lw=0.8)
        top.annotate(recording.phases[i], (start, 1.0), (3, 2), ("data", "axes fraction"), "offset points", fontsize=8)
