# SPDX-License-Identifier: Apache-2.0
"""A grasp that is taken while the tool hangs or is pressed: the dots show how far it has dragged the membranes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rendered import PERIOD

from seed_core.hand import Hand
from seed_core.membrane.material import around, rigid_motion
from seed_core.spatial import Array, make_pose, rotation_error, so3_exp
from seed_estimation import Estimator, EstimatorError, EstimatorParameters, TactileImages
from seed_estimation.contact.grasp_zero import Dragged, grasp_zero
from seed_sim.membrane.grasp import MembraneGrasp
from seed_sim.membrane.parameters import MembraneParameters
from seed_sim.tactile.parameters import TactileParameters, ToolShape
from seed_sim.tactile.renderer import MeshRenderer, TactileRenderer

HANGING = (0.0, 0.0, -0.00245)  # [m]: 0.2 kg on 800 N/m
FREE = (0.0, 0.0, 0.0)
TOOLS = {
    "cylinder": ToolShape(),
    "box": ToolShape("box", length=0.04),
    "thin": ToolShape(radius=0.008),
}


def grasped(
    p_CT: Any, tool: str = "cylinder", seed: int = 11, turn: Any = FREE, **parameters: Any
) -> tuple[Estimator, TactileRenderer]:
    """A grasp that is taken with the tool at p_CT (3,) [m], turned by turn (3,) [rad]."""
    bubbles = TactileRenderer(TactileParameters(tool=TOOLS[tool]), Hand(), seed)
    estimator = Estimator(EstimatorParameters(**parameters), Hand(), bubbles.cameras)
    estimator.capture_reference([bubbles.no_contact(-1.0 + i * PERIOD) for i in range(8)])
    X: Array = make_pose(so3_exp(np.array(turn)), np.array(p_CT))
    estimator.initialize_grasp([bubbles.render(X, (i - 5) * PERIOD) for i in range(5)])
    return estimator, bubbles


@pytest.mark.parametrize("tool", list(TOOLS))
def test_a_grasp_that_something_else_carries_is_taken_as_it_is(tool: str) -> None:
    estimator, _ = grasped(FREE, tool)
    assert not estimator.zero.words
    assert np.abs(estimator.zero.motion).max() < 1e-4
    assert not estimator.zero.loaded


@pytest.mark.parametrize("tool", ["cylinder", "box"])
@pytest.mark.parametrize("p_CT", [HANGING, (0.002, 0.0, 0.0038)], ids=["hangs", "pressed"])
def test_a_grasp_under_load_is_counted_from_where_the_tool_would_be_free(tool: str, p_CT: tuple[float, ...]) -> None:
    estimator, bubbles = grasped(p_CT, tool)
    assert "the tool hangs or is pressed" in estimator.zero.words
    X = make_pose(so3_exp(np.deg2rad((2.0, -1.0, 3.0))), 0.7 * np.array(p_CT) + 2e-4)
    seen = estimator.update(bubbles.render(X, PERIOD), PERIOD)
    assert seen.valid
    assert np.abs(seen.X_CT[:3, 3] - X[:3, 3]).max() < 1.5e-4  # [m], of up to 4 mm
    deviation = np.sqrt(seen.covariance.diagonal()[3:])
    assert deviation[2] > 0.05 * abs(p_CT[2])  # micro-slip may have hidden a part of it


@pytest.mark.parametrize("tool", ["cylinder", "box"])
@pytest.mark.parametrize(
    ("axis", "angle", "p_CT"),
    [
        ("y", 4.0, FREE),
        ("y", -7.0, HANGING),
        ("y", 12.0, (0.002, 0.0, -0.001)),
        ("x", -7.0, (0.001, 0.0, -0.001)),
        ("z", 5.0, (0.0, 0.0, -0.001)),
    ],
)
def test_a_tool_that_droops_as_it_is_grasped_is_counted_from_where_it_would_be_free(
    tool: str, axis: str, angle: float, p_CT: tuple[float, ...]
) -> None:
    """Its weight hangs beside the grasp, which is a hinge about y; about x and z the fingers are dragged apart."""
    turn = np.array([angle * (axis == a) for a in "xyz"])
    estimator, bubbles = grasped(p_CT, tool, turn=np.deg2rad(turn))
    assert f"turned about its {axis} by {angle:+.0f}"[:-1] in estimator.zero.words
    X = make_pose(so3_exp(np.deg2rad(np.array((2.0, 0.0, 3.0)) + 0.6 * turn)), 0.7 * np.array(p_CT) + 2e-4)
    seen = estimator.update(bubbles.render(X, PERIOD), PERIOD)
    assert seen.valid
    error = np.concatenate((rotation_error(seen.X_CT[:3, :3], X[:3, :3]), seen.X_CT[:3, 3] - X[:3, 3]))
    assert np.rad2deg(np.abs(error[:3])).max() < 0.5
    assert np.abs(error[3:]).max() < 2e-4
    assert error @ np.linalg.solve(seen.covariance, error) < 9.0


def test_a_grasp_under_load_is_refused_in_numbers_where_that_is_wanted_or_it_is_too_much() -> None:
    with pytest.raises(EstimatorError, match=r"z -2\.[45] \+- 0\.1 mm in C; let something carry its weight"):
        grasped(HANGING, loaded_grasp="refuse")
    grasped(FREE, loaded_grasp="refuse")
    with pytest.raises(EstimatorError, match=r"z \+3\.0"):
        grasped((0.0, 0.0, 0.003), max_drag=0.002)
    estimator, _ = grasped(HANGING, loaded_grasp="ignore")
    assert not estimator.zero.words


def test_one_membrane_that_is_dragged_while_the_other_tells_nothing_is_named_or_refused() -> None:
    """A drag of 8 mm reached beyond the search on one finger only, and nothing was said."""
    seen = Dragged(np.array((0.0, 0.0079)), 0.0, 1e-4, np.array((0.0, 0.012, 0.0)))
    zero = grasp_zero({"left": seen, "right": None})
    assert "cannot be told: the left membrane is dragged by x +0.0, z +7.9" in zero.words
    assert not zero.loaded
    crossed = Dragged(np.array((0.0, -0.0079)), 0.0, 1e-4, np.array((0.0, -0.012, 0.0)))
    assert "and no tool does both" in grasp_zero({"left": seen, "right": crossed}).words
    assert not grasp_zero({"left": seen}).words  # one bubble alone that is pressed aside looks the same
    with pytest.raises(EstimatorError, match="dragged"):
        grasped((0.0, 0.0, 0.008))


def test_dots_that_are_others_tell_nothing_and_say_so() -> None:
    one, other = (TactileRenderer(TactileParameters(), Hand(), seed) for seed in (1, 2))
    estimator = Estimator(EstimatorParameters(), Hand(), one.cameras)
    estimator.capture_reference([one.no_contact(-1.0 + i * PERIOD) for i in range(8)])
    estimator.initialize_grasp([other.render(make_pose(p=np.array(HANGING)), (i - 5) * PERIOD) for i in range(5)])
    assert "cannot be told" in estimator.zero.words
    assert not estimator.zero.loaded


def test_a_reference_without_dots_where_the_tool_touches_tells_nothing_and_says_so() -> None:
    """A lamp's reflection fills the middle of the free bubbles; the tool takes it away."""
    bubbles = TactileRenderer(TactileParameters(), Hand(), 1)

    def dazzled(stamp: float) -> dict[str, TactileImages]:
        out = {}
        for finger, images in bubbles.no_contact(stamp).items():
            ir = images.ir.copy()
            h, w = ir.shape
            ir[45 : h - 45, 65 : w - 65] = 65535.0
            out[finger] = replace(images, ir=ir)
        return out

    estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)
    estimator.capture_reference([dazzled(-1.0 + i * PERIOD) for i in range(4)])
    estimator.initialize_grasp([bubbles.render(np.eye(4), (i - 3) * PERIOD) for i in range(3)])
    assert "cannot be told" in estimator.zero.words
    assert estimator.update(bubbles.render(np.eye(4), PERIOD), PERIOD).valid


def test_a_turn_about_all_axes_is_told_apart_where_the_patches_do_not_face_each_other() -> None:
    """Their middles are 3 mm and 7 mm apart along x and z: the turn about y drags these in different directions."""
    turn, shift, pivot = np.array((0.05, 0.15, -0.08)), np.array((0.001, 0.0, -0.002)), np.array((0.001, 0.0, -0.002))

    def seen(*middle: float) -> Dragged:
        way = middle - (so3_exp(-turn) @ (middle - pivot - shift) + pivot)
        return Dragged(way[::2], turn[1], 1e-4, np.array(middle))

    zero = grasp_zero({"left": seen(0.002, 0.012, 0.004), "right": seen(-0.001, -0.011, -0.003)})
    np.testing.assert_allclose(zero.turn, turn, atol=0.012)  # of second order


@pytest.mark.parametrize("tool", ["cylinder", "box"])
def test_the_dots_show_a_turn_about_all_axes(tool: str) -> None:
    turn = np.deg2rad((-4.0, 8.0, 5.0))
    estimator, _ = grasped((0.001, 0.0, -0.001), tool, turn=turn)
    np.testing.assert_allclose(np.rad2deg(estimator.zero.turn), np.rad2deg(turn), atol=0.6)


@pytest.mark.parametrize("thickness", [0.0, 0.002, 0.005])
def test_of_a_thin_tool_a_small_difference_of_the_drags_is_no_turn(thickness: float) -> None:
    """0.45 mm is what micro-slip leaves of 3 mm: 13 degrees of a tool of 2 mm, for which nothing was corrected."""
    left = Dragged(np.array((0.0, -0.00300)), 0.0, 1e-4, np.array((0.0, 0.5 * thickness, 0.0)))
    right = Dragged(np.array((0.0, -0.00255)), 0.0, 1e-4, np.array((0.0, -0.5 * thickness, 0.0)))
    zero = grasp_zero({"left": left, "right": right})
    assert zero.loaded
    assert not zero.turn.any()
    assert zero.motion == pytest.approx((0.0, -0.002775))
    assert zero.deviation == pytest.approx(np.sqrt(1e-8 + 0.000225**2 / 2.0))


def test_a_membrane_with_mechanics_shows_the_same() -> None:
    parameters, tool = MembraneParameters(spacing=0.006), ToolShape()
    grasp = MembraneGrasp(parameters, tool)
    p = TactileParameters(tool=tool, squeeze=parameters.squeeze, height=grasp.height)
    bubbles = MeshRenderer(p, Hand(), 5, grasp.free())
    told, now = [], grasp.close()
    for z in (0.0, -0.0015):
        state = grasp.close() if z == 0.0 else grasp.solve(make_pose(p=np.array((0.0, 0.0, z))), 1.0)
        estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)
        estimator.capture_reference([bubbles.no_contact(-1.0 + i * PERIOD) for i in range(8)])
        estimator.initialize_grasp([bubbles.render(state.bubbles, (i - 5) * PERIOD) for i in range(5)])
        told.append(estimator.zero)
        seen = estimator.update(bubbles.render(state.bubbles, PERIOD), PERIOD)
    for motion in seen.membrane:  # of the band around each patch: a part of the tool's, since the grasp without load
        before, after = now.bubbles[motion.finger], state.bubbles[motion.finger]
        band = around(before.nodes.T, before.nodes[before.touching].T)
        true = rigid_motion(before.nodes[band].T, after.nodes[band].T)
        assert motion.X_CM[2, 3] == pytest.approx(true[2, 3], abs=2.0 * np.sqrt(motion.covariance[5, 5]))
        assert np.sqrt(motion.covariance[5, 5]) < 3e-4
    assert state.wrench.force[2] > 1.0  # [N]: it bears a load
    assert np.abs(told[0].motion).max() < 1e-4
    assert told[1].motion_since_free()[:3, 3] == pytest.approx((0.0, 0.0, -0.0015), abs=1.5e-4)


@pytest.mark.parametrize(("axis", "within", "goes"), [(0, 0.1, 2), (1, 0.25, 2)])
def test_a_membrane_with_mechanics_shows_how_far_the_tool_droops(axis: int, within: float, goes: int) -> None:
    """within: this share of the turn. goes: the axis along which the bands are dragged apart."""
    parameters, tool = MembraneParameters(spacing=0.006), ToolShape("box", length=0.04)
    grasp = MembraneGrasp(parameters, tool)
    bubbles = MeshRenderer(
        TactileParameters(tool=tool, squeeze=parameters.squeeze, height=grasp.height), Hand(), 5, grasp.free()
    )
    before = grasp.close()
    turn = np.zeros(3)
    turn[axis] = 0.06
    X = make_pose(so3_exp(turn))
    state = grasp.solve(X, 1.0)
    estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)
    estimator.capture_reference([bubbles.no_contact(-1.0 + i * PERIOD) for i in range(8)])
    estimator.initialize_grasp([bubbles.render(state.bubbles, (i - 5) * PERIOD) for i in range(5)])
    seen = estimator.update(bubbles.render(state.bubbles, PERIOD), PERIOD)
    error = rotation_error(seen.X_CT[:3, :3], X[:3, :3])
    assert np.abs(error).max() < within * 0.06
    assert np.abs(error[axis]) < 2.0 * np.sqrt(seen.covariance[axis, axis])
    for motion in seen.membrane:
        bubble = before.bubbles[motion.finger]
        band, middle = (
            around(bubble.nodes.T, bubble.nodes[bubble.touching].T),
            bubble.nodes[bubble.touching].mean(axis=0),
        )
        true = rigid_motion(bubble.nodes[band].T, state.bubbles[motion.finger].nodes[band].T)
        off = (motion.X_CM - true)[:3, :3] @ middle + (motion.X_CM - true)[:3, 3]
        assert np.abs(off[goes]) < 2.0 * np.sqrt(motion.covariance[3 + goes, 3 + goes])
