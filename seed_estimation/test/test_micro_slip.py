# SPDX-License-Identifier: Apache-2.0
"""Micro-slip is learnt as fast as it is seen, never believed further than that, and found by the right equation."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.spatial import Array, make_pose, so3_exp
from seed_estimation.rigid_fit.micro_slip import (
    ALIKE,
    DOUBT,
    LARGEST_STEP,
    START_DEVIATION,
    SYSTEMATIC,
    WANDER,
    MicroSlip,
    ShareInformation,
    micro_slip_information,
    share_information,
)
from seed_estimation.rigid_fit.residuals import FEW, Residuals

DT = 1.0 / 45.0
NOWHERE = np.zeros(6)


def evidence(step: float, information: float) -> ShareInformation:
    return ShareInformation(step * information, information, NOWHERE)


def _learnt(demands: Array, information: float) -> MicroSlip:
    slip = MicroSlip(0.5)
    for wanted in demands:
        slip.update(evidence(float(wanted) - slip.value, information), DT)
    return slip


def test_a_slip_that_depth_hardly_sees_stays_in_doubt() -> None:
    """One bubble: five seconds of demands that err alike by as much as the slip itself."""
    for seed in range(5):
        alike = np.repeat(np.random.default_rng(seed).normal(0.1, 0.1, 10), 23)
        slip = _learnt(alike, 50.0)
        assert abs(slip.value - 0.1) < 2.0 * slip.deviation
        assert slip.deviation > 0.4 * START_DEVIATION


def test_a_slip_of_three_per_cent_is_corrected_and_none_is_not_invented() -> None:
    noise = np.random.default_rng(4).normal(0.0, 0.03, 180)
    assert 0.02 < _learnt(0.03 + noise, 3000.0).value < 0.035
    assert _learnt(np.abs(noise) - 0.02, 3000.0).value < 0.002


def test_doubt_is_never_less_than_the_error_of_a_slip_that_is_seen_well() -> None:
    for seed in range(5):
        alike = np.repeat(np.random.default_rng(seed).normal(0.15, 0.05, 20), 12)
        slip = _learnt(alike, 3000.0)
        assert abs(slip.value - 0.15) < 3.0 * slip.deviation < 0.12


# The filter, number by number ----------------------------------------------------------------------------------------


def test_one_frame_worked_out_by_hand() -> None:
    """v = 0.01, noise = 20 / 3000 + 0.02^2 * 0.25 * 45 = 0.0111667, gain = 0.01 / 0.0211667 = 0.4724409."""
    slip = MicroSlip(0.5)
    slip.update(evidence(0.05, 3000.0), DT)
    assert_allclose(slip.estimate, 0.02362205, atol=1e-8)
    assert_allclose(slip.variance, 0.005275591, atol=1e-8)
    assert_allclose(slip.value, 0.02362205**3 / (0.02362205**2 + 0.005275591), atol=1e-8)
    assert_allclose(slip.deviation, np.sqrt(0.005275591 + (0.02362205 - slip.value) ** 2), atol=1e-8)


def test_the_second_frame_asks_from_what_is_corrected_already() -> None:
    slip = MicroSlip(0.5, estimate=0.2, variance=0.001, value=0.15)
    slip.update(evidence(0.05, 1e9), 10.0)  # sure images, slow frames: 0.15 + 0.05 is the estimate itself
    assert_allclose(slip.estimate, 0.2, atol=1e-12)
    variance = 0.001 + WANDER**2 * 10.0  # not yet at START_DEVIATION^2
    gain = variance / (variance + DOUBT / 1e9 + SYSTEMATIC**2)
    assert_allclose(slip.variance, variance * (1.0 - gain), rtol=1e-12)


def test_what_errs_alike_counts_once_in_a_quarter_of_a_second() -> None:
    """Two frames of half the time tell no more than one of the whole."""
    gains = []
    for dt in (ALIKE / 2.0, ALIKE, 2.0 * ALIKE):
        slip = MicroSlip(0.5)
        slip.update(evidence(0.1, 1e9), dt)
        gains.append(slip.estimate / 0.1)
    noise = [START_DEVIATION**2 * (1.0 / gain - 1.0) for gain in gains]
    assert_allclose(noise, np.array((2.0, 1.0, 1.0)) * SYSTEMATIC**2, rtol=1e-3)


@pytest.mark.parametrize(
    ("found", "dt"),
    [(evidence(0.1, 1e4), 0.0), (evidence(0.1, 1e4), -1.0), (evidence(np.nan, 1e4), DT), (evidence(np.inf, 1e4), DT),
     (ShareInformation(1.0, 0.0, NOWHERE), DT)],
    ids=["no time", "time runs backwards", "no number", "infinite", "no information"],
)  # fmt: skip
def test_a_frame_that_tells_nothing_changes_nothing_but_what_is_forgotten(found: ShareInformation, dt: float) -> None:
    slip = MicroSlip(0.5, estimate=0.1, variance=0.004, value=0.08)
    slip.update(found, dt)
    assert (slip.estimate, slip.value) == (0.1, 0.08)
    assert slip.variance == 0.004 + WANDER**2 * max(dt, 0.0)


def test_a_little_information_is_information() -> None:
    slip = MicroSlip(0.5)
    slip.update(evidence(0.1, 0.5), DT)
    gain = START_DEVIATION**2 / (START_DEVIATION**2 + DOUBT / 0.5 + SYSTEMATIC**2 * ALIKE / DT)
    assert_allclose(slip.estimate, 0.1 * gain, rtol=1e-12)


def test_doubt_never_grows_beyond_that_of_the_start() -> None:
    slip = MicroSlip(0.5, variance=0.0099)
    slip.update(evidence(0.0, 0.0), 100.0)
    assert slip.variance == START_DEVIATION**2


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_frame_asks_for_more_than_the_largest_step(sign: float) -> None:
    def after(step: float) -> float:
        slip = MicroSlip(0.9, estimate=0.8, variance=0.005, value=0.8)
        slip.update(evidence(sign * step, 1e4), DT)
        return slip.estimate

    assert after(7.0) == after(LARGEST_STEP)
    assert after(0.9 * LARGEST_STEP) != after(LARGEST_STEP)


def test_no_membrane_runs_ahead_of_the_tool() -> None:
    slip = MicroSlip(0.5)
    slip.update(evidence(-0.3, 1e5), DT)
    assert (slip.estimate, slip.value) == (0.0, 0.0)


def test_no_more_than_the_largest_slip_is_corrected() -> None:
    slip = _learnt(np.full(400, 0.45), 1e5)
    assert slip.estimate > 0.44
    bounded = MicroSlip(0.3)
    for _ in range(400):
        bounded.update(evidence(0.45 - bounded.value, 1e5), DT)
    assert bounded.value == 0.3
    assert bounded.deviation > 0.14  # what is not corrected is in doubt


# What images ask for -------------------------------------------------------------------------------------------------


def weighted(rng: np.random.Generator, count: int) -> tuple[Residuals, Array]:
    """Residuals of `count` points with weights, and how each changes with a share."""
    J = rng.normal(size=(6, count)).astype(np.float32)
    image = Residuals(J, np.zeros(count, int), share=0.5, floor=0.05)
    image.reweight(rng.normal(0.0, 0.3, count).astype(np.float32), rescale=True)
    return image, rng.normal(size=count).astype(np.float32)


def test_a_share_is_solved_for_together_with_the_pose() -> None:
    """The seven unknowns at once, by a general solver, ask for the same share and let the pose give way as much."""
    rng = np.random.default_rng(3)
    (left, a), (right, b), (unseen, c) = weighted(rng, 200), weighted(rng, 150), weighted(rng, FEW - 1)
    prior = np.diag(rng.uniform(1.0, 50.0, 6))
    found = share_information([unseen, left, right], [c, a, b], prior + left.H + right.H, left.g + right.g)

    H, g = np.zeros((7, 7)), np.zeros(7)
    H[:6, :6] = prior
    for image, column in ((left, a), (right, b)):
        A = np.vstack((image.J, column)).astype(float)
        W = image.w.astype(float) * image.share / image.deviation**2
        H += A * W @ A.T
        g += A * W @ image.r.astype(float)
    assert_allclose(found.gradient / found.information, np.linalg.solve(H, g)[6], rtol=1e-4)
    assert_allclose(1.0 / found.information, np.linalg.inv(H)[6, 6], rtol=1e-4)
    assert_allclose(found.effect, np.linalg.solve(H[:6, :6], H[:6, 6]), rtol=1e-3, atol=1e-6)


def test_a_share_that_looks_like_a_motion_has_no_information() -> None:
    image, _ = weighted(np.random.default_rng(4), 100)
    found = share_information([image], [image.J[2]], image.H, image.g)
    assert 0.0 <= found.information < 1e-3 * float(image.w.sum())
    assert_allclose(found.effect, np.eye(6)[2], atol=1e-4)


def test_images_that_are_not_seen_ask_for_nothing() -> None:
    unseen, column = weighted(np.random.default_rng(5), FEW - 1)
    found = share_information([unseen], [column], np.eye(6), np.zeros(6))
    assert (found.gradient, found.information) == (0.0, 0.0)
    assert_allclose(found.effect, 0.0)


def test_the_share_that_the_membrane_did_not_follow_is_asked_for() -> None:
    """Residuals as 12 % of the sideways motion leave them, the pose held by depth: 12 % is what they ask for."""
    rng = np.random.default_rng(6)
    X_CT = make_pose(so3_exp((0.02, -0.1, 0.03)), (0.002, 0.001, -0.003))
    motion = np.concatenate(((0.02, -0.1, 0.03), (0.002, 0.001, -0.003)))
    J_along = rng.normal(size=(6, 300)).astype(np.float32) * np.float32([[1.0], [1.0], [1.0], [50.0], [50.0], [50.0]])
    image = Residuals(J_along, np.zeros(300, int), share=1.0, floor=0.05)
    image.reweight((0.12 * motion @ J_along).astype(np.float32), rescale=False)
    found = micro_slip_information([image], [J_along], X_CT, image.H + 1e9 * np.eye(6), image.g)
    assert_allclose(found.gradient / found.information, 0.12, rtol=1e-3)
