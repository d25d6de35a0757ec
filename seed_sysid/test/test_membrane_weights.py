# SPDX-License-Identifier: Apache-2.0
"""Weights in place of a force sensor: which slopes they give of a toy of elastic patches, and what they do not."""

import numpy as np
import pytest
from toy_membrane import Toy

from seed_core.membrane.features import by_finger
from seed_core.spatial import Array, inverse_pose, make_pose, so3_exp
from seed_sysid.fit.weight import WeightError
from seed_sysid.membrane.weights import expected_load, fit_weights
from seed_sysid.stiffness_map import wrench_transform

MIDDLES = np.array([[0.0, 0.012, 0.0], [0.0, -0.012, 0.0]])


def hung(loads: Array, rng: np.random.Generator, curvature: float = 0.3) -> tuple[list[tuple], Array, Array]:
    """Motions, poses and wrenches about T of a toy that carries forces (n, 3) [N]: Newton's method on its stiffness."""
    motions, poses, wrenches = [], [], []
    for force in loads:
        toy, p, turn = Toy(friction=1e3, curvature=curvature), np.zeros(3), np.zeros(3)
        for _ in range(40):
            found = toy.move(make_pose(so3_exp(turn), p))
            p = p + 0.5 * (found[3:] - force) / np.array([700.0, 1000.0, 700.0])
            turn = turn + 0.5 * (found[:3] - np.cross(p, force)) / 0.3
        seen = by_finger(toy.membrane())
        for m in seen:
            m.X_CM[:3, 3] += 2e-5 * rng.normal(size=3)
        motions.append(seen)
        poses.append(make_pose(so3_exp(turn), p))
        wrenches.append(wrench_transform(inverse_pose(poses[-1])) @ np.concatenate([np.cross(p, force), force]))
    return motions, np.array(poses), np.array(wrenches)


ATTITUDES = np.vstack([np.eye(3), -np.eye(3), [[0.7, 0.7, 0], [0, 0.7, -0.7], [-0.7, 0, 0.7]]])


def test_weights_give_forces_with_intervals_and_name_what_they_do_not_load() -> None:
    found = fit_weights(*_arranged(hung(-2.0 * ATTITUDES, np.random.default_rng(1), curvature=0.0)))
    stiff = Toy(friction=1e3, curvature=0.0)
    true = [-stiff.move(make_pose(None, 1e-4 * e))[3 + i] / 1e-4 for i, e in enumerate(np.eye(3))]
    assert (np.abs(found.slope[3:] - true) < 1.5 * found.half_width[3:]).all()
    assert (found.half_width[3:] < 0.05 * np.array(true)).all()
    assert set(found.undetermined) <= {"roll", "pitch", "yaw"}
    assert "put at most" in found.undetermined["pitch"]
    assert np.isnan(found.slope[1])
    assert found.caveats[-1].startswith("not told by weights: how the axes act on each other")


def test_slopes_tell_another_load() -> None:
    motions, poses, wrenches = hung(-2.0 * ATTITUDES, np.random.default_rng(2))
    found = fit_weights(*_arranged((motions, poses, wrenches)))
    (other,), (X,), (true,) = hung(np.array([[1.0, -1.0, 0.5]]), np.random.default_rng(3))
    assert np.abs(expected_load(found, other, MIDDLES, X)[3:] - true[3:]).max() < 0.1


def test_weights_that_tell_nothing_are_refused() -> None:
    motions, poses, wrenches = hung(-2.0 * ATTITUDES[:3], np.random.default_rng(1))
    with pytest.raises(WeightError, match="3 loads are too few: hold weights in at least 6 attitudes"):
        fit_weights(motions, MIDDLES, poses, wrenches)
    light = hung(-0.01 * ATTITUDES, np.random.default_rng(1))
    with pytest.raises(WeightError, match="the weights determine no axis"):
        fit_weights(*_arranged(light))


def _arranged(data: tuple[list[tuple], Array, Array]) -> tuple[list[tuple], Array, Array, Array]:
    motions, poses, wrenches = data
    return motions, MIDDLES, poses, wrenches
