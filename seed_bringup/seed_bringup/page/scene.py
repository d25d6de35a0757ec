# SPDX-License-Identifier: Apache-2.0
"""The cell in 3-D: arm, hand, bubbles as measured, tool, table, named frames, and the wrench with its uncertainty."""

import math
from collections import deque
from typing import Any

import numpy as np
import viser

from seed_bringup.page.state import CellState, WrenchView
from seed_core.hand import FINGERS, Hand, Tool
from seed_core.meshes import (
    BUBBLE,
    FORCE_SCALE,
    PAPER,
    Bubble,
    Mesh,
    Part,
    arrow,
    ellipsoid,
    hand_parts,
    slab,
    tool_parts,
    turning_arrow,
)
from seed_core.spatial import Array, quaternion_from_rotation
from seed_ur.meshes import arm_parts, arm_poses

TORQUE_LABEL = 0.05  # [m] from the tip along the axis
LEAST_FORCE, LEAST_TORQUE = 0.2, 0.02  # [N], [N m] below which no arrow is drawn
TRAIL, TRAIL_STEP = 400, 0.002  # points of the tip's path; [m] between two of them
FORCE, TORQUE, PATH = (217, 85, 26), (118, 74, 188), (217, 85, 26)
GLASS = 0.5  # opacity of the table: the force upon it points into it
FINE, COARSE = (232, 234, 237), (214, 218, 223)  # lines of the floor
SKY, GROUND = (255, 255, 255), (176, 184, 198)  # light from above and below
LAMP = (1.0, -2.0, 3.0)  # where the other light comes from: from behind the one who looks, over the right shoulder
BOX = 12  # vertices: a mesh with no more has edges to be seen
NAMED = ("base", "tool0", "compliance", "tool", "tip")
# From where a page looks, and at what: [m] from the middle between grasp and tip; the first is how it begins.
VIEWS = {
    "Arm": ((0.85, -1.25, 0.6), (-0.2, 0.0, 0.2)),
    "Tool": ((0.42, -0.62, 0.2), (0.0, 0.0, 0.0)),
    "Above": ((0.0, -0.01, 0.9), (0.0, 0.0, 0.0)),  # a little aside, for what is up in the picture
}
FIRST = next(iter(VIEWS))
FIELD = math.radians(45.0)  # of view
FREE = 0.06  # [m] that the tip moves along the floor before the view follows


class Scene:
    """`show` a state, inside the server's `atomic()`; everything hangs below the arm's base W."""

    def __init__(self, server: viser.ViserServer, model: str = "ur5e") -> None:
        self._server, self._scene, self._model = server, server.scene, model
        self._hand, self._tool = Hand(), Tool()
        self._trail: deque[Array] = deque(maxlen=TRAIL)
        self._at: Array | None = None  # (3,) what the view is centred on
        self._framed: set[int] = set()  # pages that look there
        self.follow = self.named = True  # whether the view moves with the tip; whether frames are shown
        self._scene.set_up_direction("+z")
        self._scene.configure_environment_map(None)  # by software, light from a picture costs as much as all the rest
        self._scene.configure_default_lights(enabled=False)
        self._scene.add_light_hemisphere("/light/sky", sky_color=SKY, ground_color=GROUND, intensity=1.9)
        self._scene.add_light_directional("/light/lamp", position=LAMP, intensity=2.2)
        self._scene.add_grid("/floor", 4.0, 4.0, cell_size=0.1, cell_color=FINE, section_color=COARSE, shadow_opacity=0)
        self._links = self._groups("arm", arm_parts(model))
        self._of_hand = self._groups("hand", hand_parts(self._hand))
        self._of_tool = self._groups("held", tool_parts(self._tool))
        self._shape = slab((0.55, 0.5), 0.02, (0.12, 0.0))  # of the table, as long as nothing tells it
        self._table = self._add("/table", Part("table", "W", self._shape, PAPER, GLASS))
        self._shapes = {finger: Bubble(finger) for finger in FINGERS}
        self._bubbles = {
            finger: self._add(f"/bubble_{finger}", Part(finger, "C", bubble.mesh, BUBBLE))
            for finger, bubble in self._shapes.items()
        }
        self._frames = {name: self._add_frame(name) for name in NAMED}
        self._path = self._scene.add_line_segments("/path", np.zeros((1, 2, 3)), PATH, thickness=0.0012)
        self._force = _Arrow(self._scene, "force", FORCE, "N")
        self._torque = _Arrow(self._scene, "torque", TORQUE, "N m")

    def _add(self, name: str, part: Part) -> viser.MeshHandle:
        mesh = _mesh(self._scene, name, part.mesh, part.colour, part.opacity if part.opacity < 1.0 else None)
        mesh.visible = False
        return mesh

    def _groups(self, name: str, parts: list[Part]) -> dict[str | int, viser.FrameHandle]:
        """The parts below one node for each frame that they are fixed in."""
        groups = {p.frame: self._scene.add_frame(f"/{name}/{p.frame}", show_axes=False, visible=False) for p in parts}
        for p in parts:
            self._add(f"/{name}/{p.frame}/{p.name}", p).visible = True
        return groups

    def _add_frame(self, name: str) -> viser.FrameHandle:
        frame = self._scene.add_frame(
            f"/frame/{name}", axes_length=0.04, axes_radius=0.001, origin_radius=0.002, visible=False
        )
        label = self._scene.add_label(f"/frame/{name}/name", name, font_screen_scale=0.8, anchor="bottom-left")
        if name == "tool":  # it nearly coincides with compliance
            label.anchor = "top-right"
        return frame

    def show(self, state: CellState) -> None:
        """Put everything where it is."""
        self._learn(state)
        poses = self._poses(state)
        self._show_arm(state)
        for name, frame in self._frames.items():
            _place(frame, poses.get(name) if self.named else None)
        _place(self._table, state.X_WS)
        for group, name in ((self._of_hand, "compliance"), (self._of_tool, "tool")):
            for handle in group.values():
                _place(handle, poses.get(name))
        self._show_bubbles(state, poses.get("compliance"))
        self._show_wrench(state.touch, poses.get("tip"))
        if "tip" in poses:
            self._follow(poses["tip"][:3, 3])
        self._frame(poses)

    def clear_path(self) -> None:
        """Begin the tip's path anew."""
        self._trail.clear()
        self._path.points = np.zeros((1, 2, 3), np.float32)

    def _learn(self, state: CellState) -> None:
        """What is held, and what it works on, once they are known."""
        if state.table is not None and state.table is not self._shape:
            self._shape = state.table
            self._scene.remove_by_name("/table")
            self._table = self._add("/table", Part("table", "W", self._shape, PAPER, GLASS))
        if state.tool is not None and state.tool != self._tool:
            self._tool = state.tool
            self._scene.remove_by_name("/held")
            self._of_tool = self._groups("held", tool_parts(self._tool))

    def _poses(self, state: CellState) -> dict[str, Array]:
        """Poses in W of the frames that are known."""
        poses = {"base": np.eye(4)} if state.alive else {}
        if state.X_WE is None:
            return poses
        X_WC = state.X_WE @ state.fixed.get(("tool0", "compliance"), self._hand.X_EC)
        poses |= {"tool0": state.X_WE, "compliance": X_WC}
        if state.grasp is not None and (state.grasp.valid or state.grasp.gross_slip):
            poses["tool"] = X_WC @ state.grasp.X_CT
            poses["tip"] = poses["tool"] @ state.fixed.get(("tool", "tip"), self._tool.X_Ttip)
        return poses

    def _show_arm(self, state: CellState) -> None:
        poses = None if state.joints is None or state.X_WE is None else arm_poses(self._model, state.joints)
        for i, handle in self._links.items():
            _place(handle, None if poses is None else poses[int(i)])

    def _show_bubbles(self, state: CellState, X_WC: Array | None) -> None:
        """As the cameras see them; without cameras as the tool's pose would press them."""
        hand = self._hand
        X_C = {"left": hand.X_CL, "right": hand.X_CR}
        for finger, handle in self._bubbles.items():
            shape, depth = self._shapes[finger], state.depths.get(finger)
            if depth is not None:
                camera = state.fixed.get(("compliance", f"bubble_{finger}_optical"), X_C[finger])
                handle.vertices = shape.seen(depth.image, depth.intrinsics, camera).astype(np.float32)
            elif state.grasp is not None and state.grasp.valid:
                handle.vertices = shape.pressed(state.grasp.X_CT).astype(np.float32)
            _place(handle, X_WC)

    def _show_wrench(self, touch: WrenchView | None, tip: Array | None) -> None:
        if touch is None or tip is None:
            self._force.hide()
            self._torque.hide()
            return
        self._force.show(tip[:3, 3], touch.force, touch.covariance[:3, :3])
        self._torque.show(tip[:3, 3], touch.torque, touch.covariance[3:, 3:])

    def _follow(self, p: Array) -> None:
        if self._trail and np.linalg.norm(p - self._trail[-1]) < TRAIL_STEP:
            return
        self._trail.append(p.copy())
        if len(self._trail) > 1:
            points = np.array(self._trail, np.float32)
            self._path.points = np.stack((points[:-1], points[1:]), axis=1)

    def _frame(self, poses: dict[str, Array]) -> None:
        """The first picture of a page is of hand, tool and table; then the view follows them out of its middle."""
        if "compliance" not in poses:
            return
        X_WC = poses["compliance"]
        at = X_WC[:3, 3] + 0.5 * (X_WC @ self._tool.X_Ttip - X_WC)[:3, 3]
        move = np.zeros(3) if self._at is None else np.array((*(at - self._at)[:2], 0.0))
        far = float(np.linalg.norm(move))
        move *= 1.0 - FREE / far if self.follow and far > FREE else 0.0
        known, self._at = self._at is not None, at if self._at is None else self._at + move
        if not known or move.any():
            first = self._server.initial_camera
            place, middle = (tuple(self._at + offset) for offset in VIEWS[FIRST])
            first.position, first.look_at, first.fov = place, middle, FIELD
        self._turn_cameras(self._at, move)

    def look(self, view: str, client: viser.ClientHandle | None) -> None:
        """Turn one page's camera, or every page's, to one of VIEWS."""
        if self._at is None:
            return
        for one in self._server.get_clients().values() if client is None else (client,):
            self._turn(one.camera, self._at, view)

    def _turn(self, camera: viser.CameraHandle, at: Array, view: str) -> None:
        place, middle = (at + offset for offset in VIEWS[view])
        camera.position, camera.look_at, camera.fov = place, middle, FIELD

    def _turn_cameras(self, at: Array, move: Array) -> None:
        """To (3,) [m] on pages that have just come; on the others by `move` (3,) [m]."""
        told = {i: c.camera for i, c in self._server.get_clients().items() if c.camera.update_timestamp > 0.0}
        for i, camera in told.items():
            if i not in self._framed:  # it may have looked at it already, or from far away, as viser begins
                self._turn(camera, at, FIRST)
            elif move.any():
                camera.position = camera.position + move  # what it looks at moves with it
        self._framed = set(told)


class _Arrow:
    """A force, or a torque as an arrow that turns, with its number and where the head of the force may lie."""

    def __init__(self, scene: viser.SceneApi, name: str, color: tuple[int, int, int], unit: str) -> None:
        self._force = unit == "N"
        self._unit, self._digits = unit, 1 if self._force else 2
        self._least = LEAST_FORCE if self._force else LEAST_TORQUE
        self._root = scene.add_frame(f"/wrench/{name}", show_axes=False, visible=False)
        self._arrow = _mesh(scene, f"/wrench/{name}/arrow", self._shape(np.array((0.0, 0.0, 1.0))), color)
        spread = ellipsoid(np.zeros(3), np.eye(3))
        self._spread = _mesh(scene, f"/wrench/{name}/spread", spread, color, opacity=0.35)
        self._spread.visible = False
        self._label = scene.add_label(f"/wrench/{name}/number", "", font_screen_scale=1.1)

    def _shape(self, vector: Array) -> Mesh:
        return arrow(np.zeros(3), vector) if self._force else turning_arrow(np.zeros(3), vector)

    def hide(self) -> None:
        self._root.visible = False

    def show(self, at: Array, vector: Array, covariance: Array) -> None:
        """vector (3,) with its covariance (3, 3), from `at` (3,) [m]."""
        size = float(np.linalg.norm(vector))
        known = bool(np.isfinite(covariance).all())
        along = vector / max(size, 1e-9)
        deviation = math.sqrt(max(float(along @ covariance @ along), 0.0)) if known else 0.0
        if not math.isfinite(size) or size < max(self._least, deviation):  # it may as well be none
            self.hide()
            return
        self._root.position, self._root.visible = at, True
        self._arrow.vertices = self._shape(vector).vertices.astype(np.float32)
        end = FORCE_SCALE * vector if self._force else TORQUE_LABEL * along
        self._label.position = end
        spread = f" ± {deviation:.{self._digits}f}" if known else ""
        self._label.text = f"{size:.{self._digits}f}{spread} {self._unit}"
        self._spread.visible = known and self._force
        if self._spread.visible:
            self._spread.vertices = ellipsoid(end, covariance).vertices.astype(np.float32)


def _mesh(
    scene: viser.SceneApi, name: str, mesh: Mesh, color: tuple[int, int, int], opacity: float | None = None
) -> viser.MeshHandle:
    if len(mesh.vertices) <= BOX:  # a corner for each of its faces: none is smoothed away
        mesh = Mesh(mesh.vertices[mesh.faces.ravel()], np.arange(3 * len(mesh.faces), dtype=np.int32).reshape(-1, 3))
    return scene.add_mesh_simple(name, mesh.vertices.astype(np.float32), mesh.faces, color=color, opacity=opacity)


def _place(handle: Any, X: Array | None) -> None:
    """Put a node to X (4, 4) in W; None hides it."""
    if X is None:
        handle.visible = False
        return
    x, y, z, w = quaternion_from_rotation(X[:3, :3])
    handle.wxyz, handle.position, handle.visible = (w, x, y, z), X[:3, 3], True
