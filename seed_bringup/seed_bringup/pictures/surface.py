# SPDX-License-Identifier: Apache-2.0
"""A wipe over a curved table: the cell, the force along the true normal, and the normal that was found."""

import io

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread

from seed_bringup.demo.figures import BLUE, GREY, INK, ORANGE, STYLE
from seed_bringup.pictures.gallery import scene_of
from seed_bringup.pictures.scene import bodies, camera_on, drawn, png
from seed_core.spatial import Array
from seed_sim import evaluate
from seed_sim.closed_loop.evaluate import Evaluation
from seed_sim.replay.film import Film

TASK, SCENARIO, SEED = "follow", "cylinder", 2
SHARE, SIZE = 0.75, (560, 480)  # of the time in contact, at which the cell is shown; [pixels]


def follows() -> bytes:
    """One run with noise and delay."""
    film = Film()
    run = evaluate(TASK, scenario=SCENARIO, estimator="noisy", seed=SEED, film=film)
    touching = [m for m in film.moments if float(np.linalg.norm(m.wrench.force)) > 0.3]
    scene = scene_of(run, touching[int(SHARE * (len(touching) - 1))], film)
    cell, _ = drawn(bodies(scene), camera_on(scene, SIZE, 0.7, 0.75))
    with style.context(STYLE):
        figure = Figure(figsize=(11.0, 4.4), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
        axes = left.subplots()
        axes.imshow(imread(io.BytesIO(png(cell))))
        axes.set_axis_off()
        top, bottom = right.subplots(2, 1, sharex=True)
        _over_time(top, bottom, run)
        return png(figure)


def _tilt(normals: Array) -> Array:
    """(n,) [deg] by which normals (n, 3) are inclined along x."""
    return np.asarray(np.rad2deg(np.arctan2(normals[:, 0], normals[:, 2])))


def _over_time(top: Axes, bottom: Axes, run: Evaluation) -> None:
    recording = run.recording
    names = ("press", "wipe")
    on = np.isin(recording["phase"], [recording.phases.index(name) for name in names])
    t, normal = recording["t"][on], recording["normal"][on]
    top.plot(t, -np.einsum("ij,ij->i", recording["force"][on], normal), color=BLUE)
    top.axhline(float(np.linalg.norm(recording["wanted_force"][on][-1])), color=INK, lw=0.8, ls="--")
    top.set(ylabel="force along the normal [N]", ylim=(0.0, None))
    bottom.plot(t, _tilt(normal), color=INK, label="the surface's")
    bottom.plot(t, _tilt(recording["found_normal"][on]), color=ORANGE, label="found")
    bottom.set(xlabel="time [s]", ylabel="tilt of the normal [deg]")
    bottom.legend(loc="best", fontsize=8)
    for name in names:
        start = float(recording["t"][recording["phase"] == recording.phases.index(name)][0])
        for axes in (top, bottom):
            axes.axvline(start, color=GREY, lw=0.8)
        top.annotate(name, (start, 1.0), (3, 2), ("data", "axes fraction"), "offset points", fontsize=8)
