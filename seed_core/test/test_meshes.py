# SPDX-License-Identifier: Apache-2.0
"""Pictures' meshes are closed, face outwards and have the sizes of what they show."""

import numpy as np
import pytest

from seed_core import Hand, Tool, make_pose, so3_exp
from seed_core.meshes import (
    Bubble,
    Mesh,
    SheetBubble,
    arrow,
    box,
    capsule,
    ellipsoid,
    hand_parts,
    hills,
    slab,
    tool_parts,
    tube,
    turning_arrow,
)
from seed_core.meshes.hand import BLADE

TOOLS = ("squeegee", "pen", "torque_driver", "peg", "ball", "round_peg", "plug", "of one's own")
INTRINSICS = (200.0, 200.0, 112.0, 85.0)


def volume(mesh: Mesh) -> float:
    """Signed [m^3]: positive where the faces look outwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def assert_closed(mesh: Mesh) -> None:
    assert np.isfinite(mesh.vertices).all()
    edges = np.concatenate([mesh.faces[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    met = {(int(a), int(b)) for a, b in edges}
    assert len(met) == len(edges), "an edge is met twice in the same direction"
    assert all((b, a) in met for a, b in met), "an edge has one face only"
    assert volume(mesh) > 0.0


def test_every_part_of_the_hand_and_of_each_tool_is_closed() -> None:
    for kind in TOOLS:
        for part in (*hand_parts(), *tool_parts(kind=kind)):
            assert_closed(part.mesh)
            assert part.frame in ("C", "T")


def test_bodies_have_the_volumes_of_geometry() -> None:
    assert volume(box((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))) == pytest.approx(0.006)
    exact = np.pi * 0.05**2 * 0.2 + 4.0 / 3.0 * np.pi * 0.05**3
    assert volume(capsule(0.05, (0.1, 0.0, 0.0), (0.1, 0.2, 0.0))) == pytest.approx(exact, rel=0.03)
    assert slab((0.6, 0.5), 0.02).vertices[:, 2].max() == 0.0
    assert volume(tube([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.0, 0.0)], 0.01, 64)) == pytest.approx(
        np.pi * 1e-4, rel=0.01
    )


def test_hills_are_closed_and_as_high_as_they_are_said_to_be() -> None:
    x, y = np.linspace(0.0, 0.1, 11), np.linspace(-0.1, 0.1, 5)
    flat = hills(x, y, np.zeros((11, 5)), 0.02)
    assert_closed(flat)
    assert volume(flat) == pytest.approx(0.1 * 0.2 * 0.02)
    ramp = hills(x, y, np.broadcast_to(x[:, None], (11, 5)), 0.02)
    assert_closed(ramp)
    assert volume(ramp) == pytest.approx(0.1 * 0.2 * (0.02 + 0.05))


def test_the_hand_reaches_from_the_flange_to_the_bubbles() -> None:
    ends = np.concatenate([p.mesh.vertices for p in hand_parts()])
    assert ends[:, 2].min() == pytest.approx(-Hand().E_C.position[2])
    cases = {p.name: p.mesh.vertices for p in hand_parts()}
    assert cases["left case"][:, 1].min() == pytest.approx(0.0355)
    assert cases["left case"][:, 1].max() > Hand().C_L.position[1], "the camera sits inside"
    assert cases["right case"][:, 1].max() == pytest.approx(-0.0355)


@pytest.mark.parametrize("kind", TOOLS)
def test_a_tool_ends_at_its_tip(kind: str) -> None:
    tip = Tool().T_tip.position
    low = max(float(p.mesh.vertices[:, 2].max()) for p in tool_parts(kind=kind))
    assert low == pytest.approx(tip[2], abs=1e-6)


def test_the_blade_is_as_long_as_the_squeegee_s() -> None:
    blade = next(p for p in tool_parts(kind="squeegee") if p.name == "blade")
    assert np.ptp(blade.mesh.vertices[:, 1]) == pytest.approx(BLADE)


@pytest.mark.parametrize("finger", ["left", "right"])
def test_a_bubble_is_shown_where_the_camera_sees_it(finger: str) -> None:
    bubble, hand = Bubble(finger), Hand()
    assert_closed(bubble.mesh)
    X_CF = hand.X_CL if finger == "left" else hand.X_CR
    flat = np.full((171, 224), 0.085, np.float32)  # the membrane 85 mm off, everywhere
    seen = bubble.seen(flat, INTRINSICS, X_CF)
    assert_closed(Mesh(seen, bubble.mesh.faces))
    moved = np.abs(seen - bubble.mesh.vertices).max(axis=1) > 1e-9
    assert moved.sum() > 600
    assert np.abs(seen[moved, 1]) == pytest.approx(0.105 - 0.085, abs=1e-6)


def test_what_the_camera_does_not_see_stays_at_rest() -> None:
    bubble = Bubble("left")
    for none in (0.0, np.nan, 5.0):
        blind = np.full((171, 224), none, np.float32)
        np.testing.assert_allclose(bubble.seen(blind, INTRINSICS, Hand().X_CL), bubble.mesh.vertices, atol=1e-8)


def test_a_handle_dents_both_bubbles_and_is_not_pierced() -> None:
    X_CT = make_pose(so3_exp((0.05, 0.1, 0.0)), (0.001, 0.002, 0.0))
    for finger, side in (("left", 1.0), ("right", -1.0)):
        bubble = Bubble(finger)
        vertices = bubble.pressed(X_CT)
        assert_closed(Mesh(vertices, bubble.mesh.faces))
        in_T = (vertices - X_CT[:3, 3]) @ X_CT[:3, :3]
        assert np.hypot(in_T[:, 0], in_T[:, 1]).min() > 0.012 - 1e-4
        assert (side * (vertices - bubble.mesh.vertices)[:, 1]).max() > 0.004


def test_a_membrane_s_nodes_are_closed_behind_its_rim() -> None:
    nodes = np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, 0.0, 0.1), (0.0, 0.0, 0.1), (0.05, -0.05, 0.05)])
    sheet = SheetBubble(np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]))
    mesh = Mesh(sheet.vertices(nodes), sheet.faces)
    assert_closed(mesh)
    assert volume(mesh) == pytest.approx(0.01 * 0.05 / 3.0)


def test_an_arrow_is_as_long_as_the_force_and_points_along_it() -> None:
    mesh = arrow((0.1, 0.2, 0.3), (0.0, 0.0, -10.0), scale=0.01)
    assert_closed(mesh)
    assert mesh.vertices[:, 2].min() == pytest.approx(0.2, abs=1e-6)
    assert mesh.vertices[:, 2].max() == pytest.approx(0.3, abs=1e-6)
    for of_any_size in (np.zeros(3), (0.0, 1e-9, 0.0), (1e3, 0.0, 0.0)):
        assert_closed(arrow(np.zeros(3), of_any_size))
        assert_closed(turning_arrow(np.zeros(3), of_any_size))


def test_a_turning_arrow_turns_by_the_right_hand_rule() -> None:
    mesh = turning_arrow(np.zeros(3), (0.0, 0.0, 1.0))
    assert_closed(mesh)
    end = mesh.vertices[-1]  # the middle of the last ring: its point
    assert np.arctan2(end[1], end[0]) == pytest.approx(-0.5 * np.pi, abs=1e-6)
    before = mesh.vertices[-20:-2].mean(axis=0)  # the last rings, which the point follows
    assert np.cross(before, end)[2] > 0.0


def test_faces_stay_the_same_while_vertices_change() -> None:
    for make in (arrow, turning_arrow):
        one, other = make(np.zeros(3), (0.0, 0.0, 0.0)), make(np.ones(3), (0.3, -0.2, 5.0))
        assert (one.faces == other.faces).all()


def test_an_ellipsoid_spans_the_stated_deviations() -> None:
    mesh = ellipsoid(np.zeros(3), np.diag([0.04, 0.0, 1.0]), scale=0.01, deviations=2.0)
    assert_closed(mesh)
    assert np.abs(mesh.vertices).max(axis=0) == pytest.approx([0.004, 1e-4, 0.02], rel=0.05)
