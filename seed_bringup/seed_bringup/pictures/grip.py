# SPDX-License-Identifier: Apache-2.0
"""A tool between membranes that is pulled at: the grip that answers slip, and one that stays."""

import numpy as np
from matplotlib.figure import Figure

from seed_bringup.pictures.scene import INK, png
from seed_sim.gripper.held import DT, HeldTool, TornError
from seed_sim.gripper.pulls import draw
from seed_sim.gripper.trial import PullMoment, run_pull

SEED = 206
RED, BLUE, GREY = "#d63031", "#1f6feb", "#8a94a3"


def answers_slip() -> bytes:
    """Grip, margin and slide over time."""
    pull = draw("pull", SEED)
    answered = _columns(run_pull(pull, keep=True).moments)
    held, stays = HeldTool(pull), []
    try:
        while held.t < answered["t"][-1]:
            held.advance()
            stays.append((held.t, 1e3 * held.slid))
    except TornError:
        stays.append((held.t, 1e3 * held.slid))
    t_stays, slid_stays = np.array(stays).T
    figure = Figure(figsize=(9.6, 6.4), dpi=100, layout="constrained")
    grip, margin, slide = figure.subplots(3, 1, sharex=True)
    t = answered["t"]
    grip.plot(t, answered["load"] / (2.0 * pull.membrane.friction), color=RED, label="what friction just needs")
    grip.plot(t, answered["grip"], color=BLUE, label="grip that answers")
    grip.axhline(held.first_grip, color=GREY, ls="--", label="grip that stays")
    grip.set_ylabel("push of each finger [N]")
    margin.plot(t, answered["margin"], color=INK, lw=1.0, label="true")
    margin.plot(t, answered["told"], color=BLUE, drawstyle="steps-post", label="told, late")
    margin.set(ylabel="slip margin", ylim=(-0.05, 1.05))
    slide.plot(t_stays, slid_stays, color=GREY, ls="--", label="grip that stays: torn out")
    slide.plot(t, 1e3 * answered["slid"], color=BLUE, label="grip that answers")
    slide.set(ylabel="slid [mm]", xlabel="time [s]", xlim=(0.1, t[-1] - DT))
    for axis, free in ((grip, "upper left"), (margin, "lower left"), (slide, "upper left")):
        axis.legend(loc=free, frameon=False)
        axis.spines[["top", "right"]].set_visible(False)
    grip.set_title(
        f"A pull of {pull.strength:.2f} times what the first grip bears, within {pull.rise:.2f} s", color=INK
    )
    return png(figure)


def _columns(moments: tuple[PullMoment, ...]) -> dict[str, np.ndarray]:
    return {name: np.array([getattr(m, name) for m in moments]) for name in PullMoment._fields}
