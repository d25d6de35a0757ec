# SPDX-License-Identifier: Apache-2.0
"""The cell as a picture: arm, hand, bubbles, tool, table, the path and the force, with words at them."""

import io
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from seed_core.errors import SeedError
from seed_core.hand import FINGERS, Hand, Tool
from seed_core.meshes import BUBBLE, WOOD, Bubble, Mesh, arrow, hand_parts, tool_parts, tube
from seed_core.meshes.hand import STEEL
from seed_core.spatial import Array, inverse_pose
from seed_sim.plant.arm import ELBOW_UP
from seed_sim.replay.fixtures import fixtures, table_mesh
from seed_sim.replay.page import BEFORE, BESIDE, FORCE, PATH
from seed_sim.replay.still import Body, Camera, picture
from seed_ur.kinematics import URKinematics
from seed_ur.meshes import arm_parts, arm_poses

INK, WHITE = "#1f2937", (255, 255, 255)
_ABOVE = np.array((0.0, 0.0, 0.0015))  # [m] that a path is drawn above the table


class Word(NamedTuple):
    """Words at a point (3,) [m] of the world, shifted in pixels; with a line to the point if they are far from it."""

    text: str
    at: Array
    shift: tuple[float, float] = (0.0, 0.0)
    colour: str = INK
    size: float = 11.0


class Scene(NamedTuple):
    """What is to be seen.

    Attributes:
        X_WC, X_CT: (4, 4) gripper, and tool in the grasp.
        X_WS: (4, 4) surface of the table. table: its mesh in S; a flat one if left out.
        path: (n, 3) [m] of the tip in the world, with pressing: (n,) bool.
        force: (3,) [N] of the table on the tool, in the world.
    """

    hand: Hand
    tool: Tool
    kind: str
    X_WC: Array
    X_CT: Array
    X_WS: Array
    path: Array | None = None
    pressing: Array | None = None
    force: Array | None = None
    model: str = "ur5e"
    table: Mesh | None = None

    @property
    def tip(self) -> Array:
        """(3,) [m] in the world."""
        return np.asarray((self.X_WC @ self.X_CT @ self.tool.X_Ttip)[:3, 3])


def bodies(scene: Scene, *, arm: bool = True, table: bool = True, case: float = 1.0) -> list[Body]:
    """All of the scene; case: opacity of the bubbles' cases."""
    X_WT = scene.X_WC @ scene.X_CT
    frames = {"C": scene.X_WC, "T": X_WT}
    parts = (*hand_parts(scene.hand), *tool_parts(scene.tool, scene.kind))
    out = [
        Body(p.mesh.moved(frames[str(p.frame)]), p.colour, case if p.name.endswith("case") else p.opacity)
        for p in parts
    ]
    for finger in FINGERS:
        bubble = Bubble(finger)
        out.append(Body(Mesh(bubble.pressed(scene.X_CT), bubble.mesh.faces).moved(scene.X_WC), BUBBLE))
    if arm:
        out += _arm(scene)
    if table:
        out.append(Body((scene.table or table_mesh()).moved(scene.X_WS), WOOD))
        out += [Body(m.moved(scene.X_WS), STEEL) for m in fixtures(scene.kind, scene.tool)]
    if scene.path is not None and scene.pressing is not None:
        out += _path(scene.path, scene.pressing)
    if scene.force is not None and float(np.linalg.norm(scene.force)) > 0.1:
        out.append(Body(_force(scene), FORCE))
    return out


def _force(scene: Scene) -> Mesh:
    """The arrow, before the tool as one looks at it from beyond the table, where nothing hides it."""
    assert scene.force is not None
    at = scene.tip * (1.0, 1.0, 0.0)
    return arrow(scene.tip + 2.0 * _ABOVE + BESIDE * at / max(float(np.linalg.norm(at)), 1e-6), scene.force)


def _arm(scene: Scene) -> list[Body]:
    try:
        q = URKinematics.for_model(scene.model).follow(scene.X_WC @ inverse_pose(scene.hand.X_EC), ELBOW_UP)
    except SeedError:  # out of this arm's reach: the picture goes without
        return []
    poses = arm_poses(scene.model, np.array(q))
    return [Body(p.mesh.moved(poses[int(p.frame)]), p.colour) for p in arm_parts(scene.model)]


def _path(points: Array, pressing: Array) -> list[Body]:
    cuts = [0, *(np.flatnonzero(np.diff(pressing.astype(int))) + 1).tolist(), len(points)]
    out = []
    for a, b in pairwise(cuts):
        line, on = points[a : b + 1] + _ABOVE, bool(pressing[a])
        if len(line) > 1 and np.ptp(line, axis=0).max() > 1e-3:
            out.append(Body(tube(line, 0.0017 if on else 0.0008, 6), PATH if on else BEFORE))
    return out


def camera_on(scene: Scene, size: tuple[int, int] = (1200, 640), distance: float = 0.86, side: float = 0.5) -> Camera:
    """From beside the hand, opposite of the arm, hand and table in the picture."""
    at = scene.X_WS[:3, 3]
    out = np.array((at[0], at[1], 0.0)) / max(float(np.hypot(at[0], at[1])), 1e-6)
    across = np.array((out[1], -out[0], 0.0))
    middle = 0.5 * (scene.X_WC[:3, 3] + scene.tip) + 0.02 * out
    ways = np.sqrt(1.0 - side**2) * out + side * across + np.array((0.0, 0.0, 0.36))
    x, y, z = middle + distance * ways
    a, b, c = middle + np.array((0.0, 0.0, 0.015))
    return Camera((x, y, z), (a, b, c), 0.55, size)


def drawn(all_bodies: Sequence[Body], camera: Camera, words: Sequence[Word] = ()) -> tuple[Figure, Axes]:
    """The picture as a figure of its size, to write more on it; its coordinates are pixels."""
    pixels: Any = picture(all_bodies, camera, WHITE)
    w, h = camera.size
    figure = Figure(figsize=(w / 100.0, h / 100.0), dpi=100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(pixels, interpolation="nearest")
    axes.set_axis_off()
    axes.set(xlim=(0, w), ylim=(h, 0))
    for word in words:
        write(axes, camera, word)
    return figure, axes


def write(axes: Axes, camera: Camera, word: Word) -> None:
    """Words at a place of the world."""
    (at,), _ = camera.project([word.at])
    far = float(np.hypot(*word.shift)) > 25.0
    axes.annotate(
        word.text,
        (float(at[0]), float(at[1])),
        xytext=(float(at[0]) + word.shift[0], float(at[1]) + word.shift[1]),
        color=word.colour,
        fontsize=word.size,
        ha="center",
        va="center",
        arrowprops={"arrowstyle": "-", "color": word.colour, "lw": 0.9, "shrinkB": 1.0} if far else None,
        path_effects=[withStroke(linewidth=3.0, foreground="white")],
        zorder=9,
    )


def png(figure: Figure) -> bytes:
    """The figure as a PNG."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=100, metadata={"Software": None})
    return out.getvalue()


def setup_picture(scene: Scene, size: tuple[int, int] = (1200, 640)) -> bytes:
    """PNG of the set-up with its parts named, and the force."""
    camera = camera_on(scene, size)
    middle = scene.X_WC[:3, 3]
    left = scene.X_WC[:3, 1]
    way = _side(camera, middle, left)
    words = [
        Word("a camera inside", middle + 0.09 * left, (-130.0 * way, -75.0)),
        Word("soft bubble", middle - 0.026 * left + 0.02 * scene.X_WC[:3, 0], (215.0 * way, -15.0)),
        Word(scene.kind.replace("_", " "), middle + 0.055 * scene.X_WC[:3, 2], (170.0, 24.0)),
        Word("position-controlled arm", (scene.X_WC @ inverse_pose(scene.hand.X_EC))[:3, 3], (190.0, -30.0)),
    ]
    if scene.path is not None and scene.pressing is not None and scene.pressing.any():
        last = scene.path[np.flatnonzero(scene.pressing)[-1]]
        words.append(Word("path of the tip, blue where it presses", last, (120.0, 70.0), "#1f6feb"))
    if scene.force is not None and float(np.linalg.norm(scene.force)) > 0.1:
        total = float(np.linalg.norm(scene.force))
        rubs = abs(float(scene.force @ scene.X_WS[:3, 2])) < 0.97 * total
        text = f"{total:.1f} N on the tool" + (", with friction" if rubs else "")
        words.append(Word(text, _force(scene).vertices[-1], (-190.0, 30.0), "#d63031", 13))
    figure, _ = drawn(bodies(scene), camera, words)
    return png(figure)


def _side(camera: Camera, at: Array, way: Array) -> float:
    """1 where the direction goes to the left in the picture, else -1."""
    pixels, _ = camera.project([at, at + 0.01 * way])
    return 1.0 if pixels[1, 0] < pixels[0, 0] else -1.0
