# SPDX-License-Identifier: Apache-2.0
"""Figures of the ideas: force as the displacement of something soft, and the chain of nodes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

from seed_bringup.pictures.scene import INK, png

RED, BLUE, GREY, SOFT, WOOD = "#d63031", "#1f6feb", "#a8b0bc", "#9a6a00", "#d8b481"
STIFFNESS, PRESS = 800.0, 12.5  # [N/m], [mm]: 10 N


def series_elastic() -> bytes:
    """A hand that touches, and one that was sent further: their distance times the stiffness is the force."""
    figure = Figure(figsize=(9.6, 4.6), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    for axis, drop, head in ((left, 0.0, "touching: no force"), (right, 1.0, "commanded further: force")):
        _hand(axis, drop)
        axis.set_title(head, fontsize=13, color=INK)
        axis.set(xlim=(-3.6, 4.6), ylim=(-0.6, 7.4))
        axis.set_aspect("equal")
        axis.set_axis_off()
    right.plot((1.2, 3.0), (6.0, 6.0), color=GREY, ls="--", lw=1.2)
    right.plot((1.2, 3.0), (5.0, 5.0), color=INK, ls="--", lw=1.2)
    right.annotate("", (2.6, 5.0), (2.6, 6.0), arrowprops={"arrowstyle": "<->", "color": RED, "lw": 1.8})
    right.text(3.05, 5.5, f"{PRESS:g} mm\nbeyond the tool", color=RED, va="center", fontsize=11)
    right.annotate("", (0.0, 1.75), (0.0, 0.05), arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 3.0})
    force = STIFFNESS * 1e-3 * PRESS
    right.text(0.3, 0.85, f"{force:g} N", color=RED, fontsize=13, va="center", weight="bold")
    words = f"force = stiffness x (commanded - actual) = {STIFFNESS:g} N/m x {PRESS:g} mm = {force:g} N"
    figure.supxlabel(words, fontsize=12.5, color=INK)
    return png(figure)


def _hand(axis: Axes, drop: float) -> None:
    """Gripper, springs and tool over a table; drop: how far the gripper has been sent down."""
    axis.add_patch(Rectangle((-3.2, -0.4), 6.4, 0.4, color=WOOD, lw=0))
    axis.add_patch(Rectangle((-0.22, 0.35), 0.44, 4.2, color=BLUE, lw=0))
    axis.add_patch(Rectangle((-1.3, 0.0), 2.6, 0.35, color="#34383f", lw=0))
    top = 5.0 - drop
    axis.add_patch(Rectangle((-2.1, top + 1.0), 4.2, 0.7, color=GREY, lw=0))
    axis.text(0.0, top + 1.35, "arm and gripper", ha="center", va="center", fontsize=11, color=INK)
    for side in (-1.0, 1.0):
        axis.add_patch(Rectangle((1.75 * side - 0.25, top - 1.6), 0.5, 2.6, color=GREY, lw=0))
        x = np.linspace(0.22, 1.5, 13) * side
        zig = 0.16 * np.array([0, 1, -1] * 4 + [0])
        y = np.interp(np.abs(x), (0.22, 1.5), (3.4, top - 1.6))
        axis.plot(x, y + zig, color=SOFT, lw=2.2, solid_joinstyle="round")
    axis.text(-2.4, 2.6 if drop else 3.4, "soft\nbubbles", color=SOFT, ha="right", va="center", fontsize=11)
    axis.text(0.45, 1.2 if drop == 0.0 else 2.2, "tool", color=BLUE, fontsize=11, va="center")
    axis.text(-3.1, -0.22, "table", fontsize=10, color=INK, va="center")


BOXES = {  # centre [units], words, colour
    "cameras": ((1.0, 3.0), "cameras\nin both bubbles", "#fdf1d6"),
    "estimator": ((4.1, 3.0), "estimator\npose of the tool\nin the grasp", "#e3edff"),
    "controller": ((7.3, 3.0), "controller\nwrench, and where\nthe hand must go", "#e3edff"),
    "driver": ((10.5, 3.0), "driver\n500 Hz, limits,\nkeeps clear", "#e3edff"),
    "arm": ((10.5, 0.6), "arm", "#eceff3"),
    "tool": ((4.1, 0.6), "tool on the table", "#eceff3"),
    "task": ((7.3, 5.3), "task, or set-points\nof your own", "#e5f5ec"),
}
LINKS = (
    ("cameras", "estimator", "images"),
    ("estimator", "controller", "relative_pose"),
    ("controller", "driver", "target_frame"),
    ("driver", "arm", "servo"),
    ("arm", "tool", "moves the hand"),
    ("tool", "cameras", "dents the bubbles"),
    ("task", "controller", "setpoint"),
)


def chain() -> bytes:
    """The nodes and what goes between them."""
    figure = Figure(figsize=(12.0, 5.4), dpi=100, layout="constrained")
    axis = figure.subplots()
    for (x, y), words, colour in BOXES.values():
        box = FancyBboxPatch((x - 0.95, y - 0.6), 1.9, 1.2, "round,pad=0.05,rounding_size=0.15", fc=colour, ec=INK)
        axis.add_patch(box)
        axis.text(x, y, words, ha="center", va="center", fontsize=11, color=INK)
    for start, end, words in LINKS:
        (x0, y0), (x1, y1) = BOXES[start][0], BOXES[end][0]
        along_x = abs(x1 - x0) > abs(y1 - y0)
        if (start, end) == ("tool", "cameras"):
            a, b = (x0 - 1.0, y0), (x1, y1 - 0.66)
            connection = "angle,angleA=180,angleB=90,rad=12"
        else:
            reach = np.array((1.02, 0.0)) if along_x else np.array((0.0, 0.67))
            way = np.sign(x1 - x0) if along_x else np.sign(y1 - y0)
            a, b = (x0 + way * reach[0], y0 + way * reach[1]), (x1 - way * reach[0], y1 - way * reach[1])
            connection = "arc3"
        axis.annotate(
            "", b, a, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.4, "connectionstyle": connection}
        )
        place = (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]))
        if (start, end) == ("tool", "cameras"):
            place = (1.9, 0.6)
        up = 0.16 if along_x else 0.0
        axis.text(
            place[0] + (0.0 if along_x else 0.1), place[1] + up, words, fontsize=9.5, color=BLUE,
            ha="center" if along_x else "left", va="bottom" if along_x else "center",
        )  # fmt: skip
    axis.set(xlim=(-0.3, 12.0), ylim=(-0.3, 6.1))
    axis.set_aspect("equal")
    axis.set_axis_off()
    return png(figure)
