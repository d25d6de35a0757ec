# SPDX-License-Identifier: Apache-2.0
"""Errors of cameras carried into the pose: as large as what estimators find whose cameras are told wrongly."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import PERIOD

from seed_core.hand import Hand
from seed_core.spatial import Array, inverse_pose, make_pose, motion_adjoint, pose_from_rpy, so3_exp, so3_log
from seed_estimation import Estimator, EstimatorParameters, PinholeCamera, TactileImages
from seed_estimation.calibration.file import frame_of
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.systematic import COUNT, Systematic, gradients
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.renderer import TactileRenderer

X_CT = pose_from_rpy(np.deg2rad((9.0, -8.0, 7.0)), (0.003, -0.001, 0.002))
SIZES = {"turn": 0.01, "shift": 0.001, "focal": 0.01, "scale": 0.01, "offset": 0.001}
UNITS = np.repeat((1e-3, 1e-4), 3)  # [rad], [m] that matter alike
FIRST = {"turn": 0, "shift": 3, "focal": 6, "scale": 7, "offset": 8}
Frames = list[dict[str, TactileImages]]


@pytest.fixture(scope="module")
def images() -> tuple[dict[str, PinholeCamera], Frames, Frames, Frames]:
    """Cameras; images without contact, of the grasp, and of the way to X_CT."""
    bubbles = TactileRenderer(TactileParameters(noise=0.0, pattern=0.0, dropouts=0.0), Hand(), 41)
    way = [make_pose(so3_exp(s * so3_log(X_CT[:3, :3])), s * X_CT[:3, 3]) for s in np.linspace(0.1, 1.0, 10)]
    free = [bubbles.no_contact(-1.0 + i * PERIOD) for i in range(4)]
    held = [bubbles.render(np.eye(4), (i - 4) * PERIOD) for i in range(4)]
    return bubbles.cameras, free, held, [bubbles.render(X, (i + 1) * PERIOD) for i, X in enumerate(way)]


def found(images: tuple[dict[str, PinholeCamera], Frames, Frames, Frames], kind: str = "") -> tuple[Array, Estimator]:
    """The last pose when the left camera is wrong by `kind`, the turn about its x axis and the shift along it."""
    cameras, *series = images
    hand, size = Hand(), SIZES.get(kind, 0.0)
    if kind in ("turn", "shift"):
        step = pose_from_rpy((size if kind == "turn" else 0.0, 0, 0), (size if kind == "shift" else 0.0, 0, 0))
        hand = replace(hand, C_L=frame_of(hand.X_CL @ step))
    if kind == "focal":
        one = cameras["left"]
        K = one.K.copy()
        K[[0, 1], [0, 1]] /= 1.0 + size
        cameras = {**cameras, "left": PinholeCamera(one.width, one.height, K, one.D, one.model)}
    estimator = Estimator(EstimatorParameters(learn_slip=False), hand, cameras)

    def told(frame: dict[str, TactileImages]) -> dict[str, TactileImages]:
        left = frame["left"]
        depth = left.depth * np.float32(1 + size if kind == "scale" else 1) + np.float32(
            size if kind == "offset" else 0
        )
        return {**frame, "left": replace(left, depth=depth)}

    free, held, way = ([told(frame) for frame in part] for part in series)
    estimator.capture_reference(free)
    estimator.initialize_grasp(held)
    for frame in way:
        last = estimator.update(frame, frame["left"].stamp)
        assert last.valid, last.reason
    return last.of_patches().X_CT, estimator


def test_a_wrong_camera_moves_the_pose_by_what_was_foretold(
    images: tuple[dict[str, PinholeCamera], Frames, Frames, Frames], monkeypatch: pytest.MonkeyPatch
) -> None:
    fits: list[Fit] = []
    told = Systematic.of_pose

    def of_pose(self: Systematic, fit: Fit, by_error: tuple[Array, Array]) -> Array:
        fits.append(fit)
        return told(self, fit, by_error)

    monkeypatch.setattr(Systematic, "of_pose", of_pose)
    right, _ = found(images)
    fit = fits[-1]
    S = np.linalg.solve(fit.H, sum(gradients(fit.fingers[0], fit.X_CT)))
    for kind, size in SIZES.items():
        wrong, _ = found(images, kind)
        step = inverse_pose(right) @ wrong
        error = np.concatenate([so3_log(step[:3, :3]), step[:3, 3]]) / UNITS
        foretold = S[:, FIRST[kind]] * size / UNITS
        assert np.linalg.norm(error) > 1.0, kind
        assert np.linalg.norm(error - foretold) < 0.42 * np.linalg.norm(error), (kind, error, foretold)


def test_mounts_that_are_calibrated_to_each_other_are_known_so_well_and_their_middle_no_better() -> None:
    p, hand = EstimatorParameters(), Hand()
    X_CX = {"left": hand.X_CL, "right": hand.X_CR}
    mutual = np.repeat((0.001, 0.0001), 3)
    P, before = Systematic(p, X_CX, mutual).covariance, Systematic(p, X_CX).covariance
    left, right = (np.eye(2 * COUNT)[i * COUNT : i * COUNT + 6] for i in range(2))
    apart = motion_adjoint(hand.X_CL) @ left - motion_adjoint(hand.X_CR) @ right
    assert np.all(np.sqrt(np.diag(apart @ P @ apart.T)) < 1.01 * mutual)
    unseen = np.linalg.inv(P) - np.linalg.inv(before)
    assert np.linalg.matrix_rank(unseen, tol=1e-6 * np.linalg.norm(unseen)) == 6
