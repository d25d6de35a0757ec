# SPDX-License-Identifier: Apache-2.0
"""Material that stays where it is while the tool goes on tells that the tool slides; nothing else does."""

import numpy as np
import pytest

from seed_core.spatial import make_pose
from seed_estimation.images.sampling import crop
from seed_estimation.slip.following import WAY, Following, Step, left_behind
from seed_estimation.slip.markers import UNSEEN, Depth, sees

PERIOD = 1.0 / 45.0  # [s]
DEEP = np.array((7e-5, 5e-5, 6e-4))  # [m] depth of a long cylinder does not see its own axis


def steps(tool: tuple[float, float, float], shares: tuple[float, float], n: int = 6) -> list[Step]:
    """n steps of a tool that goes `tool` [m] in each, whose material follows by shares (of each finger)."""
    way = np.array(tool)
    share = np.array(shares)[:, None]
    return [Step(i * PERIOD, Depth(i * way, DEEP), share * way) for i in range(n)]


@pytest.mark.parametrize("tool", [(0.0, 1.2e-3, 0.0), (0.0, -1.2e-3, 0.0), (3e-4, 0.0, 0.0)])
def test_a_tool_that_goes_without_the_material_slides(tool: tuple[float, float, float]) -> None:
    assert left_behind(steps(tool, (0.05, 0.1)))
    assert left_behind(steps(tool, (-0.2, 0.1)))  # it may spring back as well


@pytest.mark.parametrize(
    ("tool", "shares"),
    [
        ((0.0, 1.2e-3, 0.0), (0.6, 0.8)),  # two thirds of the patch slide
        ((0.0, 1.2e-3, 0.0), (0.0, 0.4)),  # one finger still holds it
        ((0.0, 0.0, 1.2e-3), (0.0, 0.0)),  # along its own axis, which depth only pretends to see
        ((0.0, WAY / 6.0, 0.0), (0.0, 0.0)),  # less than is told from noise
    ],
)
def test_what_is_no_gross_slip(tool: tuple[float, float, float], shares: tuple[float, float]) -> None:
    assert not left_behind(steps(tool, shares))


CYLINDER, BOX = np.array((7e-5, 6.2e-5, 1.9e-4)), np.array((1.41e-4, 1.29e-4, 1.56e-4))  # [m] on membranes


@pytest.mark.parametrize("noise", [0.5, 1.0, 1.6])
def test_what_depth_sees_does_not_depend_on_its_noise(noise: float) -> None:
    """Noise makes all deviations larger alike, and the way that tells a slip as much longer."""
    assert sees(noise * CYLINDER).tolist() == [True, True, False]
    assert sees(noise * BOX).tolist() == [True, True, True]
    for way, told in ((6.0 * noise * BOX[2], False), (max(1.1 * WAY, 9.0 * noise * BOX[2]), True)):
        seen = steps((0.0, way / 5.0, 0.0), (0.0, 0.0))
        seen = [s._replace(tool=Depth(s.tool.displacement, noise * BOX)) for s in seen]
        assert left_behind(seen) == told


def test_what_depth_sees_too_badly_to_tell_in_time_is_not_seen() -> None:
    assert not sees(np.full(3, 5e-4)).any()  # a wide flat face
    assert not sees(UNSEEN.deviation).any()


def test_depth_that_lags_by_an_image_is_no_slip() -> None:
    seen = steps((0.0, 1.2e-3, 0.0), (1.0, 1.0))
    assert not left_behind([*seen[:-1], seen[-1]._replace(material=np.zeros((2, 3)))])


def test_the_flow_of_the_images_is_the_motion_of_the_material() -> None:
    tactile = pytest.importorskip("seed_sim.tactile", reason="needs the renderer of seed_sim")
    rendered = pytest.importorskip("rendered")
    estimator, bubbles = rendered.held(tactile.TactileParameters(), 5)
    models = estimator._tracker.models
    following = Following(models, [m.without_image() for m in models], np.array((0.01, 1.0, 1.0)))
    depth = Depth(np.zeros(3), DEEP)
    for i in range(4):
        X = make_pose(p=(6e-4 * i, 0.0, -4e-4 * i))
        pictures = bubbles.render(X, i * PERIOD)
        crops = {m.finger: crop(pictures[m.finger], m.pixels(X, m.seen)) for m in models}
        following.slides(crops, X, depth._replace(displacement=np.array((0.0, X[0, 3], X[2, 3]))), i * PERIOD)
    assert len(following._steps) == 3
    for step in following._steps:
        assert np.abs(step.material - (0.0, 6e-4, -4e-4)).max() < 5e-5
