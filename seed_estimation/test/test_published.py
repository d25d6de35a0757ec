# SPDX-License-Identifier: Apache-2.0
"""The paper's method: what it sees on rendered bubbles, and what not."""

import numpy as np
import pytest
from rendered import held

from seed_core.errors import SeedError
from seed_core.spatial import make_pose, pose_from_rpy
from seed_estimation.published import fitted_gain
from seed_sim.tactile.parameters import TactileParameters


def test_the_published_method_sees_y_and_is_blind_along_a_long_cylinder() -> None:
    """The paper's findings (Sec. VII-D) for a cylinder along z: y is good, z does not show at all."""
    estimator, bubbles = held(TactileParameters(), 12, "published")
    moved = np.linspace(-0.003, 0.003, 7)
    seen = []
    for i, v in enumerate(moved):
        y = estimator.update(bubbles.render(make_pose(p=(0.0, v, 0.0)), 0.1 * (i + 1)), 0.1 * (i + 1))
        seen.append(y.X_CT[1, 3])
    z = estimator.update(bubbles.render(make_pose(p=(0.0, 0.0, 0.004)), 1.0), 1.0)
    assert np.corrcoef(moved, seen)[0, 1] > 0.99
    # the patch grows as it is pressed: new, less indented membrane holds its mean back, on a cylinder by a quarter
    assert 0.6 < np.polyfit(moved, seen, 1)[0] < 1.1
    assert abs(z.X_CT[2, 3]) < 0.001
    assert not z.observed[2]
    assert y.observed[1]


def test_the_published_method_sees_pitch() -> None:
    estimator, bubbles = held(TactileParameters(), 12, "published")
    estimate = estimator.update(bubbles.render(pose_from_rpy((0.0, 0.12, 0.0), np.zeros(3)), 0.1), 0.1)
    assert -estimate.X_CT[2, 0] == pytest.approx(np.sin(0.12), rel=0.25)


def test_the_published_methods_constant_is_calibrated_from_known_pitches() -> None:
    estimator, bubbles = held(TactileParameters(), 12, "published")
    assert estimator.parameters.curl_gain == 1.0  # so that pitches come out as curls

    def curl(pitch: float, t: float) -> float:
        estimate = estimator.update(bubbles.render(pose_from_rpy((0.0, pitch, 0.0), np.zeros(3)), t), t)
        return float(-np.arcsin(estimate.X_CT[2, 0]))

    known = np.deg2rad((-8.0, -4.0, 4.0, 8.0))
    gain = fitted_gain([curl(p, 0.1 * (i + 1)) for i, p in enumerate(known)], known)
    assert gain * curl(0.1, 1.0) == pytest.approx(0.1, rel=0.05)
    with pytest.raises(SeedError, match="turn the tool"):
        fitted_gain([0.0, 0.0], [0.1, -0.1])
