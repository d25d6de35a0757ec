# SPDX-License-Identifier: Apache-2.0
"""Doubt in a pose goes with what the images no longer explain, and with how far the tool has been."""

from types import SimpleNamespace
from typing import cast

import numpy as np
from numpy.testing import assert_allclose

from seed_core.spatial import make_pose, so3_exp
from seed_estimation.rigid_fit.creep import CREEPT, FIRST, MOST, TURN, WAY, Creep
from seed_estimation.rigid_fit.fit import Fit


def fit(share: float, turn: float = 0.0, way: float = 0.0) -> Fit:
    X_CT = make_pose(so3_exp(np.array([0.0, turn, 0.0])), np.array([0.0, 0.0, way]))
    return cast(Fit, SimpleNamespace(X_CT=X_CT, explained={"left": share, "right": share}))


def settled(creep: Creep, share: float, turn: float, way: float) -> np.ndarray:
    for _ in range(80):
        variance = creep.update(fit(share, turn, way))
    return np.sqrt(variance)


def grasped(share: float = 0.98) -> Creep:
    creep = Creep()
    for _ in range(FIRST):
        assert_allclose(creep.update(fit(share)), 0.0)
    return creep


def test_images_that_are_explained_as_at_the_grasp_leave_no_doubt() -> None:
    assert_allclose(settled(grasped(), 0.975, 0.3, 0.005), 0.0)


def test_images_that_are_explained_less_leave_a_share_of_turn_and_way() -> None:
    deviation = settled(grasped(), 0.98 - CREEPT, 0.1, 0.002)
    assert_allclose(deviation, np.repeat((TURN * 0.1, WAY * 0.002), 3), rtol=1e-2)


def test_doubt_stays_when_the_tool_comes_back_and_has_a_bound() -> None:
    creep = grasped()
    settled(creep, 0.5, 0.1, 0.002)
    assert_allclose(settled(creep, 0.5, 0.0, 0.0), MOST * np.repeat((TURN * 0.1, WAY * 0.002), 3), rtol=1e-2)
