# SPDX-License-Identifier: Apache-2.0
"""The labelled drawing: the cell with its frames, the hand with its cameras, and a bubble cut open."""

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from seed_bringup.pictures.scene import INK, Scene, Word, bodies, drawn, png
from seed_core.hand import Hand, Tool
from seed_core.meshes import Bubble
from seed_core.meshes.bubbles import RIM
from seed_core.spatial import Array, make_pose
from seed_sim.replay.still import Camera

RED, GREEN, BLUE = "#d63031", "#168a50", "#1f6feb"
AXIS = 0.055  # [m] of a frame's arrows


def example(height: float) -> Scene:
    """The default hand above a table; height [m] of the tip over it."""
    hand, tool = Hand(), Tool()
    X_WT = make_pose(np.diag((1.0, -1.0, -1.0)), (0.45, 0.0, height + tool.T_tip.position[2]))
    return Scene(hand, tool, "squeegee", X_WT, np.eye(4), make_pose(None, (0.45, 0.0, 0.0)))


def triad(axes: Axes, camera: Camera, X: Array, length: float = AXIS) -> None:
    """Axes of a frame over the picture: x red, y green, z blue."""
    ends, _ = camera.project(np.vstack([X[:3, 3], X[:3, 3] + length * X[:3, :3].T]))
    for end, colour in zip(ends[1:], (RED, GREEN, BLUE), strict=True):
        look = {
            "arrowstyle": "-|>,head_length=0.5,head_width=0.22",
            "color": colour,
            "lw": 2.4,
            "shrinkA": 0,
            "shrinkB": 0,
        }
        axes.annotate("", tuple(end), tuple(ends[0]), arrowprops=look, zorder=8)


def cell_panel() -> tuple[Figure, Axes]:
    """The arm with W and E."""
    scene = example(0.03)
    X_WE = scene.X_WC @ np.linalg.inv(scene.hand.X_EC)
    camera = Camera((1.75, -1.5, 0.95), (0.3, 0.0, 0.27), 0.52, (620, 620))
    words = [
        Word("W  base", np.array((0.0, 0.0, 0.0)), (-90.0, 95.0), size=13),
        Word("E  tool0, the flange", X_WE[:3, 3], (135.0, -60.0), size=13),
        Word("a task's work frame, z out of the table", np.array((0.65, -0.2, 0.0)), (-20.0, 46.0), size=12),
    ]
    figure, axes = drawn(bodies(scene), camera, words)
    for X, length in ((np.eye(4), 0.22), (X_WE, 0.12), (scene.X_WS @ make_pose(None, (0.2, -0.2, 0.0)), 0.1)):
        triad(axes, camera, X, length)
    return figure, axes


def hand_panel(size: tuple[int, int] = (780, 620)) -> tuple[Figure, Axes]:
    """The hand with E, C and T, L and R, and the tip; the cases are clear, so one sees the cameras."""
    scene = example(0.02)
    h, X_WC = scene.hand, scene.X_WC
    frames = {"E": X_WC @ np.linalg.inv(h.X_EC), "C": X_WC, "L": X_WC @ h.X_CL, "R": X_WC @ h.X_CR}
    frames["tip"] = X_WC @ scene.X_CT @ scene.tool.X_Ttip
    all_bodies = bodies(scene, arm=False, table=False, case=0.28)
    middle = X_WC[:3, 3] + np.array((0.0, 0.0, 0.015))
    x, y, z = middle + np.array((0.72, -0.3, 0.2))
    camera = Camera((x, y, z), (middle[0], middle[1], middle[2]), 0.46, size)
    at = {name: X[:3, 3] for name, X in frames.items()}
    words = [
        Word("E  tool0", at["E"], (-120.0, -25.0), size=13),
        Word(
            "C  compliance,\non the gripper;\nT  tool is equal\nto it at the grasp", at["C"], (-292.0, -105.0), size=12
        ),
        Word("R  bubble_right_optical,\nlooks along its z", at["R"], (75.0, 112.0), size=12),
        Word("L  bubble_left_optical", at["L"], (-70.0, 105.0), size=12),
        Word("tip", at["tip"], (115.0, 12.0), size=13),
        Word("soft bubble", at["C"] + 0.03 * X_WC[:3, 1] + np.array((0, 0, 0.02)), (-5.0, -75.0), "#9a6a00", 12),
    ]
    figure, axes = drawn(all_bodies, camera, words)
    for name, X in frames.items():
        triad(axes, camera, X, 0.038 if name in "LR" else AXIS)
    axes.text(16, 54, "axes: x red, y green, z blue", fontsize=11, color=INK)
    return figure, axes


def cut_open(axis: Axes) -> None:
    """One bubble in the plane of y_C and z_C [mm]: camera, inside, dome, outside, tool."""
    bubble = Bubble("left")
    for vertices, style in ((bubble.mesh.vertices, (0, (4, 3))), (bubble.pressed(np.eye(4)), "-")):
        grid = vertices[:-2].reshape(16, 48, 3)
        line = 1e3 * np.concatenate([grid[:, 12], grid[::-1, 36]])[:, 1:] * (1.0, -1.0)
        if style == "-":
            axis.add_patch(Polygon(line, closed=True, color="#f6cd78", alpha=0.45, lw=0))
        axis.plot(line[:, 0], line[:, 1], color="#9a6a00", ls=style, lw=2.0 if style == "-" else 1.2)
    back, rim = 1e3 * Hand().C_L.position[1], 1e3 * RIM
    axis.add_patch(Polygon([(rim, -44), (rim, 44), (back + 8, 26), (back + 8, -26)], color="#e7eaf0", lw=0, zorder=0))
    axis.add_patch(Polygon([(-12, -62), (12, -62), (12, 62), (-12, 62)], color="#1f6feb", alpha=0.75, lw=0))
    axis.add_patch(Polygon([(back - 4, -9), (back - 4, 9), (back + 8, 9), (back + 8, -9)], color=INK, lw=0))
    axis.plot((back, 12.4), (0.0, 4.0), color="#d63031", lw=1.1)
    axis.plot((back, 42.0), (0.0, 39.0), color="#d63031", lw=0.7, ls=":")
    axis.plot((back, 42.0), (0.0, -39.0), color="#d63031", lw=0.7, ls=":")
    halo = [withStroke(linewidth=3.0, foreground="white")]
    notes = [
        ("tool", (0, -52), "white", 0),
        ("camera", (back + 2, -17), INK, 0),
        ("inside:\nair and light,\nthe camera's side", (64, -24), INK, 0),
        ("outside:\nthe tool's side", (-52, 30), INK, 0),
        ("membrane,\npressed by the tool", (54, 57), "#9a6a00", 0),
        ("depth along a ray", (60, 7.5), "#d63031", 3),
        ("at rest", (-3, 29), "#9a6a00", 0),
    ]
    for text, place, colour, turn in notes:
        effects = halo if colour != "white" else None
        axis.text(
            *place, text, color=colour, ha="center", va="center", fontsize=11, rotation=turn, path_effects=effects
        )
    axis.annotate("", (26, -60), (-26, -60), arrowprops={"arrowstyle": "->", "color": GREEN, "lw": 1.6})
    axis.text(33, -60, "y of C", color=GREEN, va="center", fontsize=11)
    axis.annotate("", (-42, -44), (-42, -4), arrowprops={"arrowstyle": "->", "color": BLUE, "lw": 1.6})
    axis.text(-46, -24, "z of C", color=BLUE, ha="right", va="center", fontsize=11)
    axis.set(xlim=(-82, 125), ylim=(-70, 70))
    axis.set_aspect("equal")
    axis.set_axis_off()


def frames_drawing() -> bytes:
    """All three side by side, as a PNG."""
    panels = [_pixels(figure) for figure, _ in (cell_panel(), hand_panel())]
    width = sum(p.shape[1] for p in panels)
    figure = Figure(figsize=(width / 100.0, 10.6), dpi=100)
    left = 0.0
    for pixels, head in zip(panels, ("The cell", "The hand: frames and cameras"), strict=True):
        w = pixels.shape[1] / width
        axes = figure.add_axes((left, 0.415, w, 0.585))
        axes.imshow(pixels)
        axes.set_axis_off()
        axes.text(16, 28, head, fontsize=15, color=INK, weight="bold")
        left += w
    below = figure.add_axes((0.14, 0.0, 0.72, 0.39))
    cut_open(below)
    below.set_title("A bubble cut open, in the plane of y and z of C", fontsize=15, color=INK, weight="bold")
    return png(figure)


def bubble_drawing() -> bytes:
    """The cut alone."""
    figure = Figure(figsize=(7.2, 4.9), dpi=100, layout="constrained")
    cut_open(figure.subplots())
    return png(figure)


def _pixels(figure: Figure) -> Array:
    from matplotlib.image import imread

    return np.asarray(imread(io.BytesIO(png(figure))))
