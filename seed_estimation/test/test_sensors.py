# SPDX-License-Identifier: Apache-2.0
"""The seam for other sensors: poses from whatever tells where material is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from seed_core.hand import Hand
from seed_core.spatial import Array, make_pose, pose_from_rpy, so3_exp, so3_log
from seed_estimation import Estimator, EstimatorError, EstimatorParameters, PinholeCamera, TactileImages
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.sensors.contract import GraspEstimator, Rows, Sensor, direction_rows, point_rows
from seed_estimation.sensors.estimator import SensorEstimator
from seed_estimation.sensors.parameters import SensorEstimatorParameters

STD = 2e-5  # [m]


@dataclass(frozen=True)
class Marked:
    """Places (N, 3) [m] in C of the dots of one finger; none: it touches nothing."""

    points: Array
    stamp: float


class Followed:
    """An `Observation`: dots that were at `before`."""

    def __init__(self, before: Array, now: Array, finger: str) -> None:
        self._before, self._now = before, now
        self.patch = ContactPatch(finger, in_contact=len(now) > 0)

    def _off(self, X_CT: Array) -> tuple[Array, Array]:
        moved = self._before @ X_CT[:3, :3].T + X_CT[:3, 3]
        return moved, moved - self._now

    def rows(self, X_CT: Array) -> Sequence[Rows]:
        moved, off = self._off(X_CT)
        return [
            Rows(off[:, i] / STD, point_rows(np.tile(np.eye(3)[i] / STD, (len(off), 1)), moved), len(off))
            for i in range(3)
        ]

    def explained(self, X_CT: Array) -> float:
        return float(np.mean(np.linalg.norm(self._off(X_CT)[1], axis=1) < 5.0 * STD))

    def slip(self, X_CT: Array) -> float:
        return 0.0 * float(X_CT[0, 3])


class Dots:
    """A `Sensor` that sees dots in three dimensions."""

    def __init__(self, finger: str) -> None:
        self._finger, self._before = finger, np.zeros((0, 3))
        self.expected: list[Array] = []  # X_CT (4, 4) where each image was told that the tool should be

    def problem(self, image: Marked) -> str:
        return "" if np.isfinite(image.points).all() else "a place is not finite"

    def capture_reference(self, images: Sequence[Marked]) -> None:
        pass

    def initialize_grasp(self, images: Sequence[Marked]) -> ContactPatch:
        self._before = np.mean([i.points for i in images], axis=0)
        return ContactPatch(self._finger, in_contact=True)

    def observe(self, image: Marked, X_CT: Array) -> Followed:
        assert X_CT.shape == (4, 4)
        self.expected.append(X_CT)
        return Followed(self._before[: len(image.points)], image.points, self._finger)

    def picture(self) -> NDArray[np.uint8]:
        return np.zeros((4, 4, 3), np.uint8)


def placed(
    fingers: Sequence[str] = ("left", "right"),
) -> tuple[SensorEstimator[Marked], dict[str, Dots], dict[str, Array]]:
    """Nothing is captured."""
    rng = np.random.default_rng(3)
    sides = {"left": np.array((0.0, 0.012, 0.0)), "right": np.array((0.0, -0.012, 0.0))}
    places = {f: sides[f] + rng.uniform(-0.006, 0.006, (12, 3)) for f in fingers}
    dots = {f: Dots(f) for f in fingers}
    sensors: dict[str, Sensor[Marked]] = {**dots}
    return SensorEstimator(sensors, SensorEstimatorParameters(), "dots"), dots, places


def grasped(fingers: Sequence[str] = ("left", "right")) -> tuple[SensorEstimator[Marked], dict[str, Array]]:
    estimator, _, places = placed(fingers)
    held(estimator, places)
    return estimator, places


def held(estimator: SensorEstimator[Marked], places: dict[str, Array]) -> None:
    seen: GraspEstimator[Marked] = estimator  # what nodes and simulation ask for
    seen.capture_reference([{f: Marked(p, 0.0) for f, p in places.items()}])
    seen.initialize_grasp([{f: Marked(p, 0.1) for f, p in places.items()}])


def frame(
    places: dict[str, Array], X: Array, t: float, rng: np.random.Generator, std: float = STD
) -> dict[str, Marked]:
    return {f: Marked(p @ X[:3, :3].T + X[:3, 3] + std * rng.standard_normal(p.shape), t) for f, p in places.items()}


def test_the_bubbles_estimator_is_one_as_well() -> None:
    camera = PinholeCamera(64, 48, np.array(((60.0, 0.0, 32.0), (0.0, 60.0, 24.0), (0.0, 0.0, 1.0))))
    bubbles: GraspEstimator[TactileImages] = Estimator(EstimatorParameters(), Hand(), {"left": camera})
    assert bubbles.fingers == ("left",)
    assert not bubbles.update({}, 1.0).valid


def test_a_finger_that_is_behind_the_other_by_more_than_a_period_is_followed_from_the_grasp_on() -> None:
    estimator, places = grasped()
    estimator.initialize_grasp([{f: Marked(p, t) for (f, p), t in zip(places.items(), (0.1, 0.12), strict=True)}])
    after = estimator.update({f: Marked(p, t) for (f, p), t in zip(places.items(), (0.117, 0.137), strict=True)}, 0.117)
    assert after.valid, after.reason


def test_a_rigid_motion_of_dots_is_found_with_a_covariance_that_holds() -> None:
    estimator, places = grasped()
    rng, squares = np.random.default_rng(7), []
    for k in range(1, 200):
        X = pose_from_rpy(np.deg2rad((2.0, 5.0, -1.0)) * k / 200, np.array((0.0006, -0.0001, 0.0004)) * k / 200)
        found = estimator.update(frame(places, X, 0.1 + 0.02 * k, rng), 0.1 + 0.02 * k)
        assert found.valid
        assert all(found.observed)
        assert found.method == "dots"
        e = np.concatenate([so3_log(found.X_CT[:3, :3] @ X[:3, :3].T), found.X_CT[:3, 3] - X[:3, 3]])
        squares.append(e @ np.linalg.solve(found.covariance, e))
    assert 1.0 < np.mean(squares) < 8.0  # 6 expected; the share of the motion that is doubted makes it less


def test_a_motion_is_doubted_by_a_share_of_it_and_dots_that_scatter_more_than_they_state_by_that() -> None:
    estimator, places = grasped()
    rng, squares = np.random.default_rng(8), []
    for k in range(1, 100):
        found = estimator.update(frame(places, np.eye(4), 0.1 + 0.02 * k, rng, 2.0 * STD), 0.1 + 0.02 * k)
        e = np.concatenate([so3_log(found.X_CT[:3, :3]), found.X_CT[:3, 3]])
        squares.append(e @ np.linalg.solve(found.covariance, e))
    assert 3.0 < np.mean(squares) < 12.0  # 6 expected; 24 by what they state
    still = np.sqrt(np.diag(found.covariance))
    for k in range(1, 21):
        moved = make_pose(so3_exp((0.0, 0.01 * k, 0.0)), (0.0, 0.0, 5e-4 * k))
        found = estimator.update(frame(places, moved, 2.1 + 0.02 * k, rng, 2.0 * STD), 2.1 + 0.02 * k)
    more = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(more, np.hypot(still, 0.015 * np.repeat((0.2, 0.01), 3)), rtol=0.25)


def test_a_large_motion_about_one_axis_is_found_to_the_last_digit() -> None:
    for X in (make_pose(so3_exp((0.0, 0.0, -0.3)), (0.003, 0.0, 0.0)), make_pose(so3_exp((-0.3, 0.0, 0.0)))):
        estimator, places = grasped()
        found = estimator.update(frame(places, X, 0.2, np.random.default_rng(1), 0.0), 0.2)
        np.testing.assert_allclose(found.X_CT, X, atol=1e-7)


def test_the_tool_is_expected_where_its_speed_takes_it_but_not_by_a_jump_while_it_was_lost() -> None:
    estimator, dots, places = placed()
    held(estimator, places)
    rng, step = np.random.default_rng(2), 5e-4  # [m] from image to image

    def seen(k: int, std: float = 0.0) -> float:
        """Way at which the tool was expected [m]."""
        X = make_pose(None, (step * k, 0.0, 0.0))
        estimator.update(frame(places, X, 0.1 + 0.02 * k, rng, std), 0.1 + 0.02 * k)
        return float(dots["left"].expected[-1][0, 3])

    ways = [seen(1), seen(2), seen(3, 1e-3), seen(4, 1e-3), seen(5), seen(6), seen(7)]
    np.testing.assert_allclose(np.array(ways) / step, (0.0, 2.0, 3.0, 2.0, 2.0, 5.0, 7.0), atol=0.01)


def test_what_was_not_captured_is_named() -> None:
    estimator, _, places = placed()
    still = {f: Marked(p, 0.1) for f, p in places.items()}
    assert "no reference" in estimator.update(still, 0.1).reason
    with pytest.raises(EstimatorError, match="no reference"):
        estimator.initialize_grasp([still])
    with pytest.raises(EstimatorError, match="no usable image of the left finger: no images"):
        estimator.capture_reference([])
    with pytest.raises(EstimatorError, match="no usable image of the right finger: no image"):
        estimator.capture_reference([{"left": still["left"]}])
    estimator.capture_reference([still])
    estimate = estimator.update({f: Marked(p, 0.2) for f, p in places.items()}, 0.2)
    assert not estimate.valid
    assert estimate.reason.startswith("no grasp")


@pytest.mark.parametrize("why", ["images", "sensor"])
def test_a_grasp_that_is_refused_leaves_none(why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was asked for since what is held is held otherwise."""
    estimator, dots, places = placed()
    held(estimator, places)
    rng = np.random.default_rng(1)
    assert estimator.update(frame(places, np.eye(4), 0.2, rng), 0.2).valid

    def refuses(_: Sequence[Marked]) -> ContactPatch:
        raise EstimatorError("nothing touches")

    monkeypatch.setattr(dots["right"], "initialize_grasp", refuses)
    with pytest.raises(EstimatorError):
        estimator.initialize_grasp([frame(places, np.eye(4), 0.3, rng)] if why == "sensor" else [])
    estimate = estimator.update(frame(places, np.eye(4), 0.4, rng), 0.4)
    assert not estimate.valid
    assert "the last one was refused" in estimate.reason


def test_one_finger_alone_is_said_to_be_one() -> None:
    estimator, places = grasped(("right",))
    found = estimator.update(frame(places, np.eye(4), 0.2, np.random.default_rng(1)), 0.2)
    assert found.valid
    assert "one finger" in found.reason
    with pytest.raises(EstimatorError, match="'left', 'right'"):
        SensorEstimator({"thumb": Dots("thumb")}, SensorEstimatorParameters(), "dots")


def test_dots_that_go_their_own_ways_are_a_slip_which_stays_until_the_next_grasp() -> None:
    estimator, places = grasped()
    rng = np.random.default_rng(5)
    reasons = [estimator.update(frame(places, np.eye(4), 0.2 + 0.02 * k, rng, 5e-4), 0.2 + 0.02 * k) for k in range(5)]
    assert "track lost" in reasons[0].reason
    assert not reasons[0].gross_slip
    assert reasons[-1].gross_slip
    assert "initialize the grasp again" in reasons[-1].reason
    assert estimator.update(frame(places, np.eye(4), 0.5, rng), 0.5).gross_slip
    estimator.initialize_grasp([frame(places, np.eye(4), 0.6, rng)])
    assert estimator.update(frame(places, np.eye(4), 0.7, rng), 0.7).valid


def test_a_grasp_ends_when_no_finger_has_touched_for_a_second() -> None:
    """What touches after that is another tool, or the same one held elsewhere."""
    estimator, places = grasped()
    rng = np.random.default_rng(6)
    empty = {f: np.zeros((0, 3)) for f in places}
    at = [estimator.update({f: Marked(p, t) for f, p in empty.items()}, t) for t in np.arange(0.2, 1.8, 0.1)]
    assert "searching" in at[0].reason
    assert "searching" in at[8].reason
    assert "initialize the grasp again" in at[-1].reason
    assert "initialize the grasp again" in estimator.update(frame(places, np.eye(4), 1.9, rng), 1.9).reason
    estimator.initialize_grasp([frame(places, np.eye(4), 2.0, rng)])
    assert estimator.update(frame(places, np.eye(4), 2.1, rng), 2.1).valid


def test_bad_frames_are_answered_with_a_reason() -> None:
    estimator, places = grasped()
    good = frame(places, np.eye(4), 0.2, np.random.default_rng(1))
    broken = Marked(np.full((12, 3), np.nan), 0.2)
    late = Marked(good["right"].points, 0.4)
    for bad, words in (
        ({"left": good["left"]}, "right"),
        ({**good, "left": broken}, "finite"),
        ({**good, "right": late}, "apart"),
    ):
        found = estimator.update(bad, 0.2)
        assert not found.valid
        assert words in found.reason
        assert estimator.patches == {}
    assert "out of order" in estimator.update(good, 0.05).reason
    infinite = Marked(np.full((12, 3), 1e200), 0.25)  # numbers, whose squares are none
    with np.errstate(all="ignore"):
        found = estimator.update(dict.fromkeys(places, infinite), 0.25)
    assert not found.valid
    assert np.isfinite(found.X_CT).all()
    assert np.isfinite(estimator.update(frame(places, np.eye(4), 0.27, np.random.default_rng(1)), 0.27).X_CT).all()
    nothing = {f: Marked(np.zeros((0, 3)), 0.3) for f in places}
    assert "touches no finger" in estimator.update(nothing, 0.3).reason


def test_a_clock_that_is_set_back_does_not_blind_it() -> None:
    estimator, places = grasped()
    rng = np.random.default_rng(3)
    assert estimator.update(frame(places, np.eye(4), 900.0, rng), 900.0).valid
    assert estimator.update(frame(places, np.eye(4), 300.0, rng), 300.0).valid
    assert "out of order" in estimator.update(frame(places, np.eye(4), 299.9, rng), 299.9).reason


def test_rows_are_the_change_with_a_small_motion() -> None:
    rng = np.random.default_rng(2)
    p, a = rng.standard_normal((5, 3)), rng.standard_normal((5, 3))
    for i in range(6):
        d = np.zeros(6)
        d[i] = 1e-6
        R = so3_exp(d[:3])
        moved = ((p @ R.T + d[3:] - p) * a).sum(1) / 1e-6
        turned = ((p @ R.T - p) * a).sum(1) / 1e-6
        np.testing.assert_allclose(point_rows(a, p)[:, i], moved, atol=1e-4)
        np.testing.assert_allclose(direction_rows(a, p)[:, i], turned, atol=1e-4)
