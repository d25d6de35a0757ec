# SPDX-License-Identifier: Apache-2.0
"""A tool that slides on its membranes is followed where depth sees it, and known the worse where depth does not."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand
from seed_core.spatial import Array, inverse_pose, make_pose, pose_from_rpy, rotation_error, so3_exp
from seed_estimation import Estimator, EstimatorParameters, report
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.micro_slip import MicroSlip
from seed_estimation.rigid_fit.residuals import motion_vector
from seed_estimation.rigid_fit.sliding import NORMALS, Sliding

tactile = pytest.importorskip("seed_sim.tactile", reason="needs the renderer of seed_sim")

PERIOD = 1.0 / 30.0
BY_MARKERS = np.diag([(1e-2 / 1e-5) ** 2] * 3 + [1e-5**-2] * 3)  # information of images that are exact
SEES, DEPTH = np.array((1, 1, 0, 1, 1, 0), bool), 6e-5  # roll, pitch, x and y of a cylinder along z; [m]
NO_ERRORS = (np.zeros((6, 1)), np.zeros((6, 1)))
KNOWN = MicroSlip(0.5, variance=0.0)


def fit_of(X_CT: Array, off: Array, noise: Array) -> Fit:
    """A fit that follows the markers, while depth puts the tool `off` (6,) from there, where it sees it."""
    H_depth = np.diag(np.where(SEES, (np.array((0.012, 0.006, 0.012, 1, 1, 1)) / DEPTH) ** 2, 1.0))
    patch = 0.004 * np.array([(u, 0.0, v) for u in (-1, 0, 1) for v in (-1, 0, 1)]).T
    fingers = [
        SimpleNamespace(
            model=SimpleNamespace(finger=name, p=patch + np.array([[0.0], [y], [0.0]])),
            depth=SimpleNamespace(H=0.5 * H_depth),
        )
        for name, y in (("left", 0.012), ("right", -0.012))
    ]
    g = -H_depth @ np.where(SEES, off + noise, 0.0)
    told = {
        "X_CT": X_CT, "ahead": np.zeros(6), "H": BY_MARKERS + H_depth, "g": g, "H_depth": H_depth, "g_depth": g,
        "fingers": fingers, "slip_information": SimpleNamespace(effect=motion_vector(X_CT)),
    }  # fmt: skip
    return cast(Fit, SimpleNamespace(**told))


def followed(slides: float, seconds: float = 6.0) -> tuple[Array, Array, Array]:
    """What is told of a tool that goes to and fro, and slides by a share of its first way along x and about x.

    Returns:
        True, told (6,) and deviations (6,) in its own frame.
    """
    rng, sliding = np.random.default_rng(4), Sliding()
    unit = DEPTH / np.array((0.012, 0.006, 0.012, 1, 1, 1))
    off = np.zeros(6)
    for i in range(int(seconds / PERIOD)):
        t = i * PERIOD
        X = make_pose(p=(0.002 * np.sin(2.0 * t), 0.0, 0.001 * np.sin(3.0 * t)))
        off = slides * min(t / 2.0, 1.0) * np.array((0.1, 0.0, 0.0, 0.002, 0.0, 0.0))
        fit = fit_of(X, off, unit * rng.normal(size=6))
        sliding.update(fit, t, KNOWN, fit.H_depth, NO_ERRORS, np.zeros((1, 1)))
    X_PT, covariance = sliding.of_pose(fit)
    return off, motion_vector(X_PT), np.sqrt(np.diag(covariance))


def test_what_depth_sees_of_a_slide_is_found() -> None:
    off, told, deviation = followed(0.5)
    error = np.abs(told - off)
    assert error[0] < 0.004 < 0.1 * off[0] + 1e-9
    assert error[3] < 5e-5 < 0.1 * off[3]
    assert (error[SEES] < 4.0 * deviation[SEES] + 1e-9).all()


def test_what_depth_does_not_see_of_it_is_known_the_worse() -> None:
    _, _, stuck = followed(0.0)
    _, _, slid = followed(0.5)
    assert (slid[~SEES] > 4.0 * stuck[~SEES]).all()
    assert (slid[~SEES] > 3.0 * slid[[0, 3]]).all()


def test_a_tool_that_sticks_stays_where_its_markers_are() -> None:
    _, told, deviation = followed(0.0)
    assert np.abs(told[:3]).max() < 1e-3
    assert np.abs(told[3:]).max() < 1e-5
    assert deviation[3:].max() < 1e-4


def test_errors_of_the_cameras_are_not_taken_for_a_slide() -> None:
    """A depth that a camera's error moves by as much as that error may be."""
    at = make_pose(p=(0.003, 0.0, 0.0))
    off = np.array((0.0, 0.0, 0.0, 3e-4, 0.0, 0.0))
    found = []
    for errs in (0.0, 3e-4):
        sliding = Sliding()
        for i in range(60):
            fit = fit_of(make_pose(p=(0.003 * np.sin(0.1 * i), 0.0, 0.0)) if i < 40 else at, off, np.zeros(6))
            by_error = (np.zeros((6, 1)), fit.H_depth[:, 3:4])  # it moves depth along x
            sliding.update(fit, i * PERIOD, KNOWN, fit.H_depth, by_error, np.array([[errs**2]]))
        found.append(sliding.of_pose(fit)[0][0, 3])
    assert found[0] > 0.8 * off[3]
    assert abs(found[1]) < 0.4 * off[3]


def test_what_depth_only_pretends_to_see_moves_nothing() -> None:
    """A flat patch whose normals err says of motions along it that there was none, in every frame alike."""
    sliding = Sliding()
    for i in range(1000):
        X = make_pose(p=(0.003 * min(i / 50, 1.0), 0.0, 0.001 * np.sin(0.3 * i)))
        fit = fit_of(X, np.zeros(6), np.zeros(6))
        H_depth = fit.H_depth.copy()
        H_depth[3, 3] = H_depth[5, 5] = 2.0 * NORMALS**2 * np.trace(H_depth[3:, 3:])
        g = H_depth @ np.array((0, 0, 0, X[0, 3], 0, X[2, 3]))
        fit.__dict__.update(H_depth=H_depth, g_depth=g, g=g, H=BY_MARKERS + H_depth)
        sliding.update(fit, i * PERIOD, KNOWN, H_depth, NO_ERRORS, np.zeros((1, 1)))
        assert np.abs(motion_vector(sliding.of_pose(fit)[0])[3:]).max() < 1e-4


def test_a_micro_slip_that_is_not_known_yet_is_no_slide() -> None:
    """Markers that follow nine tenths of the motion, before anyone has found that out."""
    unknown = MicroSlip(0.5)
    told = []
    for slip in (KNOWN, unknown):
        sliding = Sliding()
        for i in range(90):
            x = 0.002 * np.sin(0.1 * i)
            fit = fit_of(make_pose(p=(x, 0.0, 0.0)), np.array((0.0, 0.0, 0.0, 0.1 * x, 0.0, 0.0)), np.zeros(6))
            sliding.update(fit, i * PERIOD, slip, fit.H_depth, NO_ERRORS, np.zeros((1, 1)))
            told.append(abs(sliding.of_pose(fit)[0][0, 3]))
    assert max(told[:90]) > 1e-4
    assert max(told[90:]) < 3e-5


def goes_on(sliding: Sliding, stamps: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """What is told of a tool that has slid by 0.15 mm along x, and goes on to and fro, at the last of these times."""
    unit = DEPTH / np.array((0.012, 0.006, 0.012, 1, 1, 1))
    for t in stamps:
        X = make_pose(p=(0.002 * np.sin(2.0 * t), 0.0, 0.001 * np.sin(3.0 * t)))
        fit = fit_of(X, np.array((0.0, 0.0, 0.0, 1.5e-4, 0.0, 0.0)), unit * rng.normal(size=6))
        sliding.update(fit, t, KNOWN, fit.H_depth, NO_ERRORS, np.zeros((1, 1)))
    X_PT, covariance = sliding.of_pose(fit)
    return motion_vector(X_PT), covariance


@pytest.mark.parametrize("after", [20.0, 3.0], ids=["a pause", "a clock that is set back"])
def test_a_slide_is_not_forgotten_over(after: float) -> None:
    rng, sliding = np.random.default_rng(4), Sliding()
    goes_on(sliding, np.arange(0.0, 10.0, PERIOD), rng)
    told, covariance = goes_on(sliding, after + PERIOD * np.arange(2), rng)
    assert told[3] == pytest.approx(1.5e-4, abs=4e-5)
    assert np.linalg.eigvalsh(covariance).min() > -1e-15


def slid(share: float) -> Array:
    return pose_from_rpy(share * np.deg2rad((0.0, 5.0, 0.0)), share * np.array((0.0012, 0.0, 0.0)))


def test_on_images_the_tool_is_found_where_it_has_slid_to_and_its_patches_where_they_are() -> None:
    """All of the patch goes on together, as no residual of one image tells."""
    renderer = tactile.TactileRenderer(tactile.TactileParameters(), Hand(), 12)
    estimator = Estimator(EstimatorParameters(), Hand(), renderer.cameras)
    estimator.capture_reference([renderer.no_contact(-2.0 + 0.02 * i) for i in range(12)])
    estimator.initialize_grasp([renderer.render(np.eye(4), -0.2 + 0.02 * i) for i in range(6)])
    last: RelativePoseEstimate | None = None
    for i in range(1, 120):
        t = i * PERIOD
        X = pose_from_rpy(
            np.deg2rad((2.0 * np.sin(2.0 * t), 3.0 * np.sin(1.7 * t), 0.0)), (1e-3 * np.sin(1.9 * t), 0, 0)
        )
        X_slid = slid(min(t / 2.5, 1.0))
        last = estimator.update(renderer.render(X, t, X_slid, 0.5), t)
        assert last.valid, last.reason
    assert last is not None
    error = np.concatenate((rotation_error(last.X_CT[:3, :3], X[:3, :3]), last.X_CT[:3, 3] - X[:3, 3]))
    patches = last.of_patches()
    behind = X @ inverse_pose(X_slid)
    assert np.rad2deg(np.abs(error[:2])).max() < 1.0
    assert np.abs(error[3:5]).max() < 1.5e-4
    assert error @ np.linalg.solve(last.covariance, error) < 25.0  # 99.97 % of an honest one
    assert np.abs(patches.X_CT[:3, 3] - behind[:3, 3]).max() < 1.5e-4
    assert np.rad2deg(np.abs(rotation_error(patches.X_CT[:3, :3], behind[:3, :3]))).max() < 1.0


def test_a_slide_of_the_tool_is_told_in_the_axes_of_the_hand() -> None:
    """Its tool's x lies along the hand's y, and more than 2 mm of doubt are told."""
    X_PT, covariance = slid(1.0), np.diag((0.0, 0.0, 0.0, 0.003**2, 0.0, 0.0))
    stuck = RelativePoseEstimate(0.0, make_pose(so3_exp(np.array((0.0, 0.0, np.pi / 2)))), 1e-8 * np.eye(6))
    told = report.slid(stuck, X_PT, covariance)
    assert_allclose(told.X_CT, stuck.X_CT @ X_PT)
    assert told.covariance[4, 4] == pytest.approx(0.003**2 + 1e-8)
    assert told.covariance[3, 3] == pytest.approx(1e-8)
    assert "how far is known to 0 degrees and 3.0 mm" in told.reason
    assert_allclose(told.of_patches().covariance, stuck.covariance, atol=1e-18)


def test_of_patches_takes_the_slide_back() -> None:
    X_CT, X_PT = make_pose(so3_exp(np.array((0.1, 0.0, 0.2))), np.array((1e-3, 2e-3, 0.0))), slid(1.0)
    estimate = RelativePoseEstimate(0.0, X_CT, 3.0 * np.eye(6), X_PT=X_PT, covariance_PT=np.eye(6))
    patches = estimate.of_patches()
    assert_allclose(patches.X_CT @ X_PT, X_CT, atol=1e-12)
    assert_allclose(patches.covariance, 2.0 * np.eye(6))
    assert_allclose(patches.of_patches().X_CT, patches.X_CT)
