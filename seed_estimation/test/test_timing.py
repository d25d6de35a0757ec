# SPDX-License-Identifier: Apache-2.0
"""Fingers that are skewed and depth that lags, found while the tool moves, and what that does to the pose."""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from rendered import PERIOD

from seed_core.hand import Hand
from seed_core.spatial import Array, make_pose, pose_from_rpy
from seed_estimation import Estimator, EstimatorParameters
from seed_estimation.rigid_fit.timing import Delay, Late, Timing, late, share
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.renderer import TactileRenderer


def truth(t: float) -> Array:
    """Up to 30 mm/s and 40 degrees/s."""
    s = np.sin(np.array((4.0, 5.0, 6.0, 7.0, 8.0, 9.0)) * t) * min(t, 1.0)
    return pose_from_rpy(0.09 * s[:3], np.array((0.003, 0.0015, 0.003)) * s[3:])


def followed(skew: float, stamped: bool, learnt: bool) -> tuple[Estimator, float, bool]:
    """Estimator after 3 s of motion; rms error [m] of the last second; whether all was valid."""
    bubbles = TactileRenderer(TactileParameters(), Hand(), 52)
    start = {} if learnt else {"finger_skew_std": 0.0, "depth_lag_std": 0.0}
    estimator = Estimator(EstimatorParameters(**start), Hand(), bubbles.cameras)
    estimator.capture_reference([bubbles.no_contact(-1.0 + i * PERIOD) for i in range(8)])
    estimator.initialize_grasp([bubbles.render(np.eye(4), (i - 8) * PERIOD) for i in range(8)])
    errors, valid = [], True
    for t in np.arange(PERIOD, 3.0, PERIOD).tolist():
        right = bubbles.finger("right", truth(t - skew) if t > skew else np.eye(4), t)
        frame = {"left": bubbles.finger("left", truth(t), t), "right": right}
        if stamped:
            frame["right"] = replace(right, stamp=t - skew)
        estimate = estimator.update(frame, t)
        valid &= estimate.valid and not estimate.gross_slip
        errors.append(np.linalg.norm(estimate.X_CT[:3, 3] - truth(t)[:3, 3]))
    return estimator, float(np.sqrt(np.mean(np.square(errors[-45:])))), valid


def test_fingers_that_are_skewed_are_found_out_and_named_and_the_pose_is_better_for_it() -> None:
    learnt, error, valid = followed(0.018, stamped=False, learnt=True)
    _, without, _ = followed(0.018, stamped=False, learnt=False)
    assert valid
    assert learnt.timing is not None
    assert learnt.timing.skew.estimate == pytest.approx(0.018, abs=0.005)
    assert any("right finger's images are" in words for words in learnt.timing.words())
    assert error < 0.5 * without


def test_a_skew_that_is_stamped_needs_not_be_learnt() -> None:
    estimator, error, valid = followed(0.011, stamped=True, learnt=True)
    assert valid
    assert estimator.timing is not None
    assert abs(estimator.timing.skew.estimate) < 0.004
    assert not estimator.timing.words()
    assert error < 6e-5


def test_the_delay_that_least_squares_finds_is_the_one_put_in() -> None:
    """Two quadratic costs, one of which wants the pose of a moment ago."""
    rng = np.random.default_rng(8)
    H = [a @ a.T for a in (rng.normal(size=(6, 9)) for _ in range(2))]
    speed, delay = rng.normal(size=6), 0.013
    wanted = [np.zeros(6), -delay * speed]
    best = np.linalg.solve(H[0] + H[1], H[0] @ wanted[0] + H[1] @ wanted[1])
    g = [h @ (best - w) for h, w in zip(H, wanted, strict=True)]  # of each cost, at the best pose for both
    found = late(H[0] + H[1], g[0] + g[1], H[1], g[1], speed)
    assert found.step == pytest.approx(delay)
    assert np.allclose(best, found.effect * delay)


def test_a_delay_is_believed_no_further_than_it_is_known() -> None:
    rng = np.random.default_rng(9)
    for true in (0.0, 0.015):
        delay = Delay(0.01)
        doubt = [delay.deviation]
        for _ in range(200):
            step = true + rng.normal(0.0, 0.01) - delay.value
            delay.update(Late(step, 2e5, np.zeros(6)), delay.value, PERIOD)
            doubt.append(delay.deviation)
        assert abs(delay.value - true) < 3.0 * delay.deviation
        assert all(b < a + 2e-3 for a, b in pairwise(doubt))
    assert Delay(0.0).deviation == 0.0


def test_the_lag_of_the_motion_before_is_no_more_where_the_tool_is_found_again_at_rest() -> None:
    """As far as depth lags, a pose is put on by the speed; after a pause the speed is another."""
    timing = Timing(0.01, 0.05)
    timing.lag.estimate, timing.lag.variance = 0.04, 1e-8

    class Seen(NamedTuple):
        X_CT: Array
        H = np.diag((1e4,) * 3 + (1e8,) * 3)
        H_depth = 0.5 * H
        g = g_depth = np.zeros(6)
        fingers: tuple[()] = ()

    def at(x: float) -> Seen:
        return Seen(make_pose(None, (x, 0.0, 0.0)))

    timing.learn(at(0.001), np.eye(4), 0.02, None)  # type: ignore[arg-type]  # 50 mm/s
    assert timing.corrected(np.eye(4))[0, 3] > 5e-4
    timing.resume(at(0.001), make_pose(None, (0.001, 0.0, 0.0)), 0.4)  # type: ignore[arg-type]
    np.testing.assert_allclose(timing.corrected(np.eye(4)), np.eye(4), atol=1e-9)
    timing.resume(at(0.002), at(0.001).X_CT, 0.02)  # type: ignore[arg-type]
    assert timing.corrected(np.eye(4))[0, 3] > 5e-4
    assert timing.covariance[3, 3] > 0.0


def test_fingers_almost_a_frame_apart_do_not_push_each_other_off() -> None:
    """At the speed of one frame an error of one finger came back larger in the next frame, on the other side."""
    estimator, error, valid = followed(-0.021, stamped=True, learnt=True)
    assert valid
    assert estimator.timing is not None
    assert not estimator.timing.words()
    assert error < 2e-4


def test_a_finger_that_is_behind_goes_by_the_speed_of_one_frame() -> None:
    """An averaged speed is that of a motion that has turned round meanwhile: it erred by 0.11 mm."""
    _, error, valid = followed(0.021, stamped=False, learnt=True)
    assert valid
    assert error < 9e-5


def test_half_of_a_speed_counts_as_half_of_it_and_what_late_images_do_not_see_as_nothing() -> None:
    """A skew made up for an averaged speed that is smaller, by 55 ms and more in a motion to and fro."""
    rng = np.random.default_rng(10)
    H, H_late = (a @ a.T for a in (rng.normal(size=(6, 9)) for _ in range(2)))
    speed = rng.normal(size=6)
    assert share(H + H_late, H_late, speed, 0.5 * speed) == pytest.approx(0.5)
    unseen = np.diag((1.0, 1.0, 1.0, 1.0, 1.0, 0.0))
    along = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert share(2.0 * np.eye(6), unseen, np.ones(6), np.ones(6) + along) == pytest.approx(1.0)
