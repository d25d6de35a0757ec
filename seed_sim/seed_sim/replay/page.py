# SPDX-License-Identifier: Apache-2.0
"""A film as one HTML page: arm, hand, bubbles, tool, table, force and torque in 3-D, with time under a slider.

The page is viser's own client with the recording inside; it asks no network for anything.
"""

import contextlib
import io
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from seed_core.errors import FailedError, SeedError
from seed_core.hand import FINGERS, Hand, Tool
from seed_core.meshes import (
    BUBBLE,
    PAPER,
    WOOD,
    Bubble,
    Mesh,
    Part,
    SheetBubble,
    arrow,
    hand_parts,
    tool_parts,
    tube,
    turning_arrow,
)
from seed_core.meshes.hand import BLADE, STEEL
from seed_core.meshes.shapes import Colour
from seed_core.spatial import Array, quaternion_from_rotation
from seed_sim.plant.arm import ELBOW_UP
from seed_sim.replay.film import Moment
from seed_sim.replay.fixtures import fixtures, table_mesh
from seed_ur.kinematics import KinematicsError, URKinematics
from seed_ur.meshes import arm_parts, arm_poses

FORCE, TORQUE, PATH, BEFORE = (214, 48, 49), (136, 84, 208), (31, 111, 235), (150, 160, 176)
BESIDE = 0.045  # [m] that the arrow of the force stands before the tool, to be seen
_GRAIN = 2e-5  # [m] to which vertices are kept: the file is half as large
_TOUCH = 0.3  # [N] from which the tip draws its path
_RINGS, _SECTORS = 10, 32


def replay_page(
    moments: Sequence[Moment],
    hand: Hand,
    tool: Tool,
    kind: str,
    X_WS: Array,
    *,
    model: str = "ur5e",
    triangles: Mapping[str, Array] | None = None,
    table: Mesh | None = None,
    blade_width: float = BLADE,
) -> str:
    """The page.

    Args:
        moments: of a film, at least one.
        hand, tool: where their frames lie. kind: of the tool, see `tool_parts`.
        X_WS: (4, 4) surface of the table, z out of it.
        model: of the arm; where a moment has no joint angles, those that reach its pose.
        triangles: of the membranes by finger, where the moments have nodes.
        table: in the frame S; a flat one if left out.
        blade_width: [m] of a squeegee's blade.

    Raises:
        SeedError: there is no moment, or viser is not installed.
    """
    if not moments:
        raise FailedError("there is nothing to show yet: no moment was kept")
    with _silent_server() as server:
        held = tool_parts(tool, kind, blade_width=blade_width)
        scene = _Stage(server, hand, tool, held, X_WS, model, triangles or {}, table or table_mesh())
        for i, mesh in enumerate(fixtures(kind, tool)):
            scene.add(f"/fixture/{i}", mesh.moved(X_WS), STEEL)
        scene.draw_path(moments)
        scene.show(moments[0])
        server.flush()
        recording = server.get_scene_serializer()
        for before, moment in pairwise(moments):
            recording.insert_sleep(moment.t - before.t)
            scene.show(moment)
        recording.insert_sleep(0.1)
        return str(recording.as_html())


@contextlib.contextmanager
def _silent_server() -> Iterator[Any]:
    """A viser server whose scene is only recorded; it listens to this computer alone while the page is made."""
    try:
        import viser
    except ImportError as error:
        raise FailedError("a replay needs viser: pip install viser==1.1.1") from error
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


class _Stage:
    """The scene of a server: built once, then moved from moment to moment."""

    def __init__(
        self,
        server: Any,
        hand: Hand,
        tool: Tool,
        held: Sequence[Part],
        X_WS: Array,
        model: str,
        triangles: Mapping[str, Array],
        table: Mesh,
    ) -> None:
        self._scene, self._X_EC, self._X_Ttip = server.scene, hand.X_EC, tool.X_Ttip
        self._model, self._kinematics = model, URKinematics.for_model(model)
        self._q: tuple[float, ...] = tuple(ELBOW_UP)
        self._light(server, X_WS, table.moved(X_WS))
        self._frames = {f: self._frame(f"/{f}") for f in ("C", "T", *map(str, range(7)))}
        for part in (*hand_parts(hand), *held, *arm_parts(model)):
            self.add(f"/{part.frame}/{part.name.replace(' ', '_')}", part.mesh, part.colour)
        self._dome = {f: Bubble(f, rings=_RINGS, sectors=_SECTORS) for f in FINGERS}
        self._sheets = {f: SheetBubble(t, turn=f == "right") for f, t in triangles.items()}
        self._bubbles = {f: self._bubble(f) for f in FINGERS}
        self._arrows = {
            "force": self.add("/force", arrow(np.zeros(3), np.zeros(3)), FORCE),
            "torque": self.add("/torque", turning_arrow(np.zeros(3), np.zeros(3)), TORQUE),
        }
        self._words = {
            name: self._scene.add_label(f"/{name}_label", "", font_screen_scale=1.3, depth_test=False)
            for name in self._arrows
        }

    def _light(self, server: Any, X_WS: Array, table: Mesh) -> None:
        """Camera on hand, tool and table from beside the arm; table and lights."""
        scene, at = self._scene, X_WS[:3, 3]
        out = np.array((at[0], at[1], 0.0)) / max(float(np.hypot(at[0], at[1])), 1e-6)
        self._out = out
        side = np.array((out[1], -out[0], 0.0))
        middle = at + 0.05 * out + np.array((0.0, 0.0, 0.13))
        server.initial_camera.position = tuple(middle + 0.78 * out + 0.4 * side + np.array((0.0, 0.0, 0.2)))
        server.initial_camera.look_at = tuple(middle)
        server.initial_camera.fov = 0.8
        scene.configure_environment_map(None)
        scene.configure_default_lights(True, cast_shadow=True)
        scene.add_light_ambient("/light", intensity=1.2)
        self.add("/table", table, WOOD)
        low = float(table.vertices[:, 2].min())
        scene.add_grid(
            "/floor",
            4.0,
            4.0,
            cell_size=0.1,
            section_size=0.5,
            position=(0.0, 0.0, min(low, 0.0) - 0.002),
            plane_color=PAPER,
            plane_opacity=1.0,
        )

    def _frame(self, name: str) -> Any:
        return self._scene.add_frame(name, show_axes=False)

    def add(self, name: str, mesh: Mesh, colour: Colour, opacity: float | None = None) -> Any:
        """A mesh; its handle."""
        vertices, faces = _rounded(mesh.vertices), mesh.faces
        return self._scene.add_mesh_simple(name, vertices, faces, color=colour, opacity=opacity)

    def _bubble(self, finger: str) -> Any:
        sheet = self._sheets.get(finger)
        if sheet is None:
            return self.add(f"/C/{finger}_bubble", self._dome[finger].mesh, BUBBLE, 0.85)
        n = int(sheet.faces.max()) + 1
        return self.add(f"/C/{finger}_bubble", Mesh(np.zeros((n, 3)), sheet.faces), BUBBLE, 0.85)

    def draw_path(self, moments: Sequence[Moment]) -> None:
        """Where the tip goes over the whole film: blue where it presses, grey elsewhere."""
        tips = np.array([(m.X_WE @ self._X_EC @ m.X_CT @ self._X_Ttip)[:3, 3] for m in moments])
        pressing = np.array([float(np.linalg.norm(m.wrench.force)) > _TOUCH for m in moments])
        cuts = [0, *(np.flatnonzero(np.diff(pressing)) + 1).tolist(), len(tips)]
        for i, (a, b) in enumerate(pairwise(cuts)):
            line = tips[a : min(b + 1, len(tips))]
            moved = np.ptp(line, axis=0).max() > 1e-3
            if len(line) > 1 and moved:
                on = bool(pressing[a])
                mesh = tube(line, 0.0015 if on else 0.0007, 6)
                self.add(f"/path/{i}", mesh, PATH if on else BEFORE)

    def show(self, moment: Moment) -> None:
        """Move everything to where it is at this moment."""
        X_WC = moment.X_WE @ self._X_EC
        X_WT = X_WC @ moment.X_CT
        for name, X in (("C", X_WC), ("T", X_WT), *zip(map(str, range(7)), self._arm(moment), strict=True)):
            frame = self._frames[name]
            frame.wxyz, frame.position = np.roll(quaternion_from_rotation(X[:3, :3]), 1), X[:3, 3]
        for finger, handle in self._bubbles.items():
            if finger in self._sheets and finger in moment.nodes:
                vertices = self._sheets[finger].vertices(moment.nodes[finger])
            else:
                vertices = self._dome[finger].pressed(moment.X_CT)
            _change(handle, vertices)
        self._load(moment, (X_WT @ self._X_Ttip)[:3, 3])

    def _load(self, moment: Moment, tip: Array) -> None:
        """Arrows of what the tool does to what it touches; the force ends where it acts."""
        torque, force = moment.wrench.torque, moment.wrench.force
        beside = tip + BESIDE * self._out + np.array((0.0, 0.0, 0.004))
        meshes = {"force": arrow(beside, -force), "torque": turning_arrow(tip, torque)}  # as the table pushes back
        size = {"force": float(np.linalg.norm(force)), "torque": float(np.linalg.norm(torque))}
        words = {"force": f"{size['force']:.1f} N", "torque": f"{size['torque']:.2f} N m"}
        shown = {"force": size["force"] > 0.05, "torque": size["torque"] > 0.01}
        for name, mesh in meshes.items():
            _change(self._arrows[name], mesh.vertices)
            label = self._words[name]
            label.position = mesh.vertices[-1] + np.array((0.0, 0.0, 0.01))
            label.text, label.visible = words[name], shown[name]

    def _arm(self, moment: Moment) -> Array:
        """(7, 4, 4) poses of the arm's links."""
        if moment.q:
            self._q = moment.q
        else:
            with contextlib.suppress(KinematicsError, SeedError):  # out of this arm's reach: shown where it was
                self._q = tuple(self._kinematics.follow(moment.X_WE, self._q))
        return arm_poses(self._model, np.array(self._q))


def _rounded(vertices: Array) -> Array:
    return np.asarray(np.round(vertices / _GRAIN) * _GRAIN, np.float32)


def _change(handle: Any, vertices: Array) -> None:
    """New vertices, where they differ."""
    new = _rounded(vertices)
    if not np.array_equal(new, handle.vertices):
        handle.vertices = new
