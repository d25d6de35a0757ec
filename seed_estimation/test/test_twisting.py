# SPDX-License-Identifier: Apache-2.0
"""The middle and the edge of a patch turn apart where it breaks loose from its edge inwards."""

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from seed_core.spatial import make_pose
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.sampling import Crop
from seed_estimation.slip.twisting import Twisting

SIDE, FOCAL, AWAY = 200, 400.0, 0.06  # [px], [px], [m] from the camera to the patch
RADIUS, REACH = 0.009, 0.01  # [m]


def grid() -> tuple[np.ndarray, np.ndarray]:
    v, u = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    scale = np.float32(AWAY / FOCAL)
    return (u - SIDE / 2) * scale, (v - SIDE / 2) * scale


def image(middle: float, edge: float) -> Crop:
    """Of a patch that has turned by so much [rad] in its middle and along its edge."""
    texture = cv2.GaussianBlur(np.random.default_rng(1).normal(size=(SIDE, SIDE)), (0, 0), 3.0).astype(np.float32)
    x, z = grid()
    turn = np.interp(np.hypot(x, z) / RADIUS, (0.65, 0.75), (middle, edge))  # between the two rings
    c, s = np.cos(turn), np.sin(turn)
    before = ((c * x - s * z), (s * x + c * z))  # where it was: a turn by -turn about y
    u, v = ((p * FOCAL / AWAY + SIDE / 2).astype(np.float32) for p in before)
    ir = cv2.remap(1000.0 + 2000.0 * texture, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return Crop(ir.astype(np.float32), np.full((SIDE, SIDE), AWAY, np.float32), (0, 0))


def watching(p: np.ndarray) -> Twisting:
    """A patch of points (3, N) in T."""
    K = np.array(((FOCAL, 0.0, SIDE / 2), (0.0, FOCAL, SIDE / 2), (0.0, 0.0, 1.0)))
    X_XC = make_pose(np.array(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))), np.array((0.0, 0.0, AWAY)))
    camera = PinholeCamera(SIDE, SIDE, K, np.zeros(5), "plumb_bob")
    patch = SimpleNamespace(points=SimpleNamespace(p=p.astype(np.float32)))
    model: Any = SimpleNamespace(finger="left", camera=camera, X_XC=X_XC, patch=patch)
    return Twisting([model], REACH)


@pytest.fixture
def twisting() -> Twisting:
    x, z = (a[::4, ::4].ravel() for a in grid())
    inside = np.hypot(x, z) < RADIUS
    return watching(np.stack((x[inside], 0.0 * x[inside], z[inside])))


MARKERS: list[Any] = [SimpleNamespace(X_CT=np.eye(4))]


@pytest.mark.parametrize(("middle", "edge"), [(0.05, 0.05), (-0.05, -0.02), (0.04, 0.0)])
def test_how_far_the_middle_and_the_edge_turn(twisting: Twisting, middle: float, edge: float) -> None:
    assert twisting.step({"left": image(0.0, 0.0)}, MARKERS, turns=True) is None  # of no earlier image
    step = twisting.step({"left": image(middle, edge)}, MARKERS, turns=True)
    assert step is not None
    np.testing.assert_allclose(step, REACH * np.array((middle, edge)), atol=REACH * 0.004)


def test_markers_that_rest_are_not_looked_at(twisting: Twisting) -> None:
    twisting.step({"left": image(0.0, 0.0)}, MARKERS, turns=True)
    assert twisting.step({"left": image(0.05, 0.0)}, MARKERS, turns=False) is None


def test_a_patch_out_of_view_tells_nothing(twisting: Twisting) -> None:
    beside: list[Any] = [SimpleNamespace(X_CT=make_pose(np.eye(3), np.array((0.1, 0.0, 0.0))))]
    twisting.step({"left": image(0.0, 0.0)}, beside, turns=True)
    assert twisting.step({"left": image(0.05, 0.0)}, beside, turns=True) is None


def test_a_ring_tells_nothing() -> None:
    """It has no middle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    ring = watching(RADIUS * np.stack((np.cos(angle), 0.0 * angle, np.sin(angle))))
    ring.step({"left": image(0.0, 0.0)}, MARKERS, turns=True)
    assert ring.step({"left": image(0.05, 0.0)}, MARKERS, turns=True) is None
