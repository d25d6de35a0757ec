# SPDX-License-Identifier: Apache-2.0
"""Truth and estimate of each axis over time, drawn as in the paper's Fig. 4."""

from pathlib import Path

import numpy as np

from seed_testing.validation.scores import Series, components

_LABELS = ("x [mm]", "y [mm]", "z [mm]", "roll [deg]", "pitch [deg]", "yaw [deg]")
_COLOURS = {"published": "#d1495b", "rigid_fit": "#00798c"}


def draw(runs: dict[str, Series], path: Path, title: str) -> Path:
    """Writes a figure of six rows with truth and each method's estimate; returns the file."""
    from matplotlib.figure import Figure

    from seed_sim.replay.plots import save

    path = path if path.suffix else path.with_suffix(".png")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(9.0, 11.0), layout="constrained")
    rows = figure.subplots(6, 1, sharex=True)
    any_run = next(iter(runs.values()))
    times = np.array([e.stamp for e in any_run.estimates])
    truth = np.array([components(X) for X in any_run.X_true])
    lost = np.full(6, np.nan)  # where an estimate is not valid its line breaks
    found = {k: np.array([components(e.X_CT) if e.valid else lost for e in s.estimates]) for k, s in runs.items()}
    for i, row in enumerate(rows):
        row.plot(times, truth[:, i], color="0.65", linewidth=3.0, label="truth")
        for name, values in found.items():
            row.plot(times, values[:, i], color=_COLOURS.get(name), linewidth=1.0, label=name.replace("_", " "))
        margin = 0.6 * float(np.ptp(truth[:, i])) + 0.5
        row.set(ylim=(truth[:, i].min() - margin, truth[:, i].max() + margin), ylabel=_LABELS[i])
        row.grid(alpha=0.3)
    rows[0].legend(ncols=3, loc="upper right")
    rows[0].set_title(f"Pose of the tool in the grasp: {title}")
    rows[-1].set_xlabel("time [s]")
    save(figure, path, dpi=110)
    return path
