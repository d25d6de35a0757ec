# SPDX-License-Identifier: Apache-2.0
"""A replay shows arm, hand, both bubbles, tool, table, forces and path, and moves them; so does a still picture."""

import base64
import re
from functools import cache
from typing import Any

import numpy as np
import pytest

from seed_core import Hand, SeedError, Tool, Wrench, make_pose
from seed_core.meshes import SheetBubble, box, tool_parts
from seed_sim.membrane.mesh import ellipse_mesh, moulded_dome
from seed_sim.membrane.parameters import MembraneParameters
from seed_sim.plant.tools import TOOLS, shape_of
from seed_sim.replay import Film, Moment
from seed_sim.replay.fixtures import fixtures
from seed_sim.replay.page import replay_page
from seed_sim.replay.still import Body, Camera, picture

X_WE = make_pose(np.diag((1.0, -1.0, -1.0)), (0.45, 0.0, 0.3))
DOWN = Wrench(torque=np.array((0.1, 0.0, 0.0)), force=np.array((0.0, 0.0, -10.0)))


def moments(n: int) -> list[Moment]:
    """A tool that is pressed 2 mm into the grasp while it moves on."""
    poses = [make_pose(X_WE[:3, :3], X_WE[:3, 3] + np.array((0.01 * i, 0.0, 0.0))) for i in range(n)]
    return [Moment(0.1 * i, X, make_pose(None, (0.0, 5e-4 * i, 0.0)), (), DOWN, {}) for i, X in enumerate(poses)]


@cache
def recording() -> tuple[str, dict[str, Any]]:
    pytest.importorskip("viser", reason="draws the replay")
    msgspec, zstandard = pytest.importorskip("msgspec"), pytest.importorskip("zstandard")
    html = replay_page(moments(5), Hand(), Tool(), "squeegee", make_pose(None, (0.45, 0.0, 0.03)))
    found = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', html)
    assert found
    packed = base64.b64decode(found[1])
    inner = zstandard.ZstdDecompressor().decompress(packed[8:], max_output_size=int.from_bytes(packed[:8], "little"))
    return html, msgspec.msgpack.decode(inner[8 : 8 + int.from_bytes(inner[:8], "little")])


def messages(of: str) -> list[tuple[float, dict[str, Any]]]:
    return [(t, m) for t, m in recording()[1]["messages"] if m.get("name") == of]


def test_a_replay_holds_the_whole_cell() -> None:
    for name in (
        "/0/base", "/1/shoulder", "/2/upper_arm", "/3/forearm", "/4/wrist_1", "/5/wrist_2", "/6/wrist_3",
        "/C/palm", "/C/left_bubble", "/C/right_bubble", "/T/handle", "/T/blade", "/table", "/force", "/torque",
    ):  # fmt: skip
        assert any("MeshMessage" in m["type"] for _, m in messages(name)), name
    assert messages("/path/0"), "the path is drawn"
    assert recording()[1]["durationSeconds"] == pytest.approx(0.5, abs=0.01)


def test_bubbles_deform_and_the_arm_moves_over_time() -> None:
    for name in ("/C/left_bubble", "/C/right_bubble", "/6", "/C"):
        assert len({round(t, 3) for t, _ in messages(name)}) >= 4, name


def test_numbers_stand_at_the_arrows() -> None:
    said = str(messages("/force_label")) + str(messages("/torque_label"))
    assert "10.0 N" in said
    assert "0.10 N m" in said


def test_the_first_picture_is_framed_on_hand_and_table() -> None:
    cameras = {m["type"]: m for _, m in recording()[1]["messages"] if "Camera" in m["type"]}
    eye = np.array(cameras["SetCameraPositionMessage"]["position"])
    target = np.array(cameras["SetCameraLookAtMessage"]["look_at"])
    assert np.linalg.norm(target - (0.45, 0.0, 0.15)) < 0.1
    assert np.linalg.norm(eye - target) < 1.0


def test_a_film_without_moments_is_refused() -> None:
    with pytest.raises(SeedError, match="nothing to show"):
        replay_page([], Hand(), Tool(), "pen", np.eye(4))
    assert not Film().moments


@pytest.mark.parametrize("kind", ["squeegee", "pen", "torque_driver", "peg", "ball"])
def test_the_drawn_tool_touches_where_the_simulated_one_does(kind: str) -> None:
    tool = Tool()
    drawn = np.concatenate([p.mesh.vertices for p in tool_parts(tool, kind)])
    touching = shape_of(kind, tool).points
    lowest = touching[np.isclose(touching[:, 2], touching[:, 2].max())]
    assert drawn[:, 2].max() == pytest.approx(lowest[0, 2], abs=1e-6)
    near = drawn[drawn[:, 2] > lowest[0, 2] - 1e-3]
    assert np.ptp(near[:, :2], axis=0).max() == pytest.approx(max(np.ptp(lowest[:, :2], axis=0).max(), 2e-3), abs=3e-3)


@pytest.mark.parametrize("kind", TOOLS)
def test_every_tool_has_a_drawing_of_its_own(kind: str) -> None:
    rod = tool_parts(Tool(), "none that is known")
    assert [len(p.mesh.faces) for p in tool_parts(Tool(), kind)] != [len(p.mesh.faces) for p in rod]


def test_the_blade_is_drawn_as_wide_as_it_is_simulated() -> None:
    (blade,) = (p for p in tool_parts(Tool(), "squeegee", blade_width=0.05) if p.name == "blade")
    assert np.ptp(blade.mesh.vertices[:, 1]) == pytest.approx(np.ptp(shape_of("squeegee", Tool(), 0.05).points[:, 1]))
    wide, narrow = (replay_page(moments(2), Hand(), Tool(), "squeegee", np.eye(4), blade_width=w) for w in (0.2, 0.05))
    assert wide != narrow


def test_a_still_picture_shows_a_body_where_the_camera_projects_it() -> None:
    camera = Camera((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5, (80, 60))
    pixels = picture([Body(box((0.1, 0.1, 0.1), (0.0, 0.1, 0.1)), (200, 30, 30))], camera)
    red = np.argwhere(pixels[..., 0].astype(int) - pixels[..., 1] > 40)
    (at,), _ = camera.project([(0.05, 0.1, 0.1)])
    assert abs(red.mean(axis=0)[::-1] - at).max() < 1.5
    assert (pixels[0, 0] == 255).all()


def test_what_is_nearer_hides_what_is_behind_it_and_clear_bodies_do_not() -> None:
    camera = Camera((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5, (40, 30))
    behind, before = box((0.1, 0.3, 0.3), (-0.2, 0.0, 0.0)), box((0.1, 0.2, 0.2), (0.2, 0.0, 0.0))
    middles = []
    for opacity in (1.0, 0.5):
        pixels = picture([Body(behind, (0, 200, 0)), Body(before, (200, 0, 0), opacity)], camera)
        middles.append(pixels[15, 20].astype(int))
    assert middles[0][0] > 4 * middles[0][1]
    assert middles[1][1] > 2 * middles[0][1]


@pytest.mark.parametrize(("finger", "side"), [("left", 1.0), ("right", -1.0)])
def test_membranes_of_the_simulation_face_the_tool(finger: str, side: float) -> None:
    p = MembraneParameters()
    mesh = ellipse_mesh(p.rim_x, p.rim_z, 0.01)
    sheet = SheetBubble(mesh.triangles, turn=finger == "right")
    vertices, faces = sheet.vertices(moulded_dome(mesh, p, side)), sheet.faces
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0.0


@pytest.mark.parametrize(
    ("kind", "count"), [("peg", 4), ("torque_driver", 2), ("pen", 0), ("round_peg", 4), ("plug", 4)]
)
def test_what_stands_on_the_table_leaves_room_for_the_tool(kind: str, count: int) -> None:
    walls = fixtures(kind, Tool())
    assert len(walls) == count
    for wall in walls:
        assert np.abs(wall.vertices[:, :2]).max(axis=0).max() > 0.008
        assert wall.vertices[:, 2].min() == pytest.approx(0.0)
        inside = (np.abs(wall.vertices[:, :2]) < 1e-3).all(axis=1)
        assert not inside.any()
