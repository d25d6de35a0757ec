# SPDX-License-Identifier: Apache-2.0
"""Messages to core values and back: round trips, orders of storage, and refusals with words."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("rclpy", reason="needs ROS 2")

from geometry_msgs.msg import Pose
from geometry_msgs.msg import Wrench as WrenchMsg
from scipy.spatial.transform import Rotation

from seed_core.errors import SeedError
from seed_core.estimate import DEFORMATIONS, MembraneMotion, RelativePoseEstimate
from seed_core.spatial import Wrench, make_pose
from seed_ros import conversions as c
from seed_ros.images.arrays import depth_from_message, gray_from_message, image_message

RNG = np.random.default_rng(5)


def some_pose() -> np.ndarray:
    return make_pose(Rotation.random(random_state=RNG.integers(1 << 31)).as_matrix(), RNG.normal(size=3))


def test_poses_survive_the_round_trip() -> None:
    for X in [np.eye(4), *(some_pose() for _ in range(50))]:
        assert_allclose(c.pose_to_matrix(c.fill_pose(Pose(), X)), X, atol=1e-12)
        message = c.transform_stamped(X, 12.25, "base", "tool0").transform
        q = message.rotation
        assert_allclose(Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), X[:3, :3], atol=1e-12)


def test_stamps_survive_to_the_nanosecond_of_a_double() -> None:
    for t in (0.0, 0.999999999, 1.5, 1_763_702_400.123456):
        assert c.seconds(c.stamp_from_seconds(t)) == pytest.approx(t, abs=2e-7)
    assert c.stamp_from_seconds(0.9999999999).sec == 1  # nanosec stays below 1e9


def test_covariance_is_rotation_first_inside_and_translation_first_outside() -> None:
    diagonal = np.diag([1e-4, 2e-4, 3e-4, 4e-6, 5e-6, 6e-6])
    estimate = RelativePoseEstimate(
        3.5, some_pose(), diagonal, (True, False, True, True, False, True), method="m",
        X_PT=some_pose(), covariance_PT=0.5 * diagonal,
    )  # fmt: skip
    message = c.estimate_to_message(estimate, "compliance", "tool")
    assert_allclose(np.diag(message.pose.covariance.reshape(6, 6)), [4e-6, 5e-6, 6e-6, 1e-4, 2e-4, 3e-4])
    back = c.estimate_from_message(message)
    assert_allclose(back.covariance, diagonal)
    assert_allclose(back.X_CT, estimate.X_CT, atol=1e-12)
    assert_allclose(back.of_patches().X_CT, estimate.of_patches().X_CT, atol=1e-12)
    assert_allclose(back.of_patches().covariance, 0.5 * diagonal)
    assert (back.observed, back.stamp, back.method) == (estimate.observed, 3.5, "m")


def membrane() -> MembraneMotion:
    diagonal = np.diag([1e-4, 2e-4, 3e-4, 4e-6, 5e-6, 6e-6])
    seen = (True, False, True, True, False, True)
    deformation, place = RNG.normal(size=DEFORMATIONS), RNG.normal(size=3)
    return MembraneMotion("right", some_pose(), diagonal, seen, deformation, 2e-4, place, 3e-3, 1031.5)


def test_what_the_membranes_do_survives_the_round_trip() -> None:
    motion = membrane()
    message = c.estimate_to_message(RelativePoseEstimate(0.0, np.eye(4), membrane=(motion,)), "compliance", "tool")
    back = c.estimate_from_message(message).membrane[0]
    for name in ("X_CM", "covariance", "deformation", "centroid"):
        assert_allclose(getattr(back, name), getattr(motion, name), atol=1e-12)
    for name in ("finger", "observed", "area", "indentation", "pressure"):
        assert getattr(back, name) == getattr(motion, name)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m.pose.covariance.__setitem__(7, float("nan")), r"relative_pose\.covariance has a value"),
        (lambda m: m.membrane[0].motion.covariance.__setitem__(3, float("inf")), "membrane has a value that is not"),
        (lambda m: m.membrane[0].deformation.__setitem__(1, float("nan")), "membrane has a value that is not finite"),
        (lambda m: m.membrane[0].deformation.append(0.0), f"deformation has {DEFORMATIONS + 1} values; {DEFORMATIONS}"),
    ],
)
def test_an_estimate_with_bad_numbers_is_refused_where_it_is_valid(change, words: str) -> None:
    """One that is not valid tells no numbers, and has to count as such."""
    estimate = RelativePoseEstimate(1.0, np.eye(4), membrane=(membrane(),))
    message = c.estimate_to_message(estimate, "compliance", "tool")
    change(message)
    with pytest.raises(SeedError, match=words):
        c.estimate_from_message(message)
    message.valid, message.reason = False, "dark"
    back = c.estimate_from_message(message)
    assert (back.valid, back.reason, back.membrane) == (False, "dark", ())


def test_a_torque_that_is_not_finite_and_a_stamp_far_ahead_are_refused() -> None:
    wrench = c.fill_wrench(WrenchMsg(), Wrench.zero())
    wrench.torque.y = float("nan")
    with pytest.raises(SeedError, match="is not finite"):
        c.wrench_to_core(wrench)
    c.check_not_ahead(10.49, 10.0, 0.5, "current_pose")
    c.check_not_ahead(1.0, 10.0, 0.5, "current_pose")
    with pytest.raises(SeedError, match=r"current_pose is stamped 0\.510 s ahead .* \(at most 0\.5 s\)"):
        c.check_not_ahead(10.51, 10.0, 0.5, "current_pose")


def test_wrenches_keep_torque_and_force_apart() -> None:
    wrench = Wrench(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    message = c.fill_wrench(WrenchMsg(), wrench)
    assert (message.torque.x, message.force.z) == (1.0, 6.0)
    assert_allclose(c.wrench_to_core(message).vector(), wrench.vector())


def test_what_is_not_finite_or_no_rotation_is_refused_by_name() -> None:
    pose = c.fill_pose(Pose(), np.eye(4))
    pose.orientation.w = 0.9
    with pytest.raises(SeedError, match=r"setpoint\.orientation has norm 0\.9; a unit quaternion"):
        c.pose_to_matrix(pose, "setpoint")
    pose.orientation.w, pose.position.x = 1.0, float("nan")
    with pytest.raises(SeedError, match="setpoint has a value that is not finite"):
        c.pose_to_matrix(pose, "setpoint")
    wrench = WrenchMsg()
    wrench.force.z = float("inf")
    with pytest.raises(SeedError, match="wanted wrench has a value that is not finite"):
        c.wrench_to_core(wrench, "wanted wrench")
    estimate = c.estimate_to_message(RelativePoseEstimate(0.0, np.eye(4), slip=float("nan")), "compliance", "tool")
    with pytest.raises(SeedError, match=r"relative_pose\.slip = nan is not finite"):
        c.estimate_from_message(estimate)
    estimate = c.estimate_to_message(RelativePoseEstimate(0.0, np.eye(4)), "compliance", "tool")
    estimate.slid.covariance[0] = float("inf")
    with pytest.raises(SeedError, match=r"relative_pose\.slid\.covariance has a value that is not finite"):
        c.estimate_from_message(estimate)
    with pytest.raises(SeedError, match=r"target_frame\.header\.frame_id = 'map' is unknown here; known: base"):
        c.check_frame("map", ("base",), "target_frame")


def test_depth_comes_in_metres_from_both_encodings_and_nothing_is_nan() -> None:
    metres = np.array([[0.1, 0.0, np.nan], [-1.0, np.inf, 0.25]], dtype=np.float32)
    expected = np.array([[0.1, np.nan, np.nan], [np.nan, np.nan, 0.25]], dtype=np.float32)
    assert_allclose(depth_from_message(image_message(metres, "32FC1", 1.0, "cam")), expected)
    millimetres = np.array([[100, 0], [250, 65535]], dtype=np.uint16)
    depth = depth_from_message(image_message(millimetres, "16UC1", 1.0, "cam"))
    assert_allclose(depth, [[0.1, np.nan], [0.25, 65.535]], rtol=1e-6)


def test_padded_rows_and_big_endian_bytes_are_understood() -> None:
    data = np.arange(6, dtype=">u2").reshape(2, 3)
    message = image_message(data.astype("<u2"), "mono16", 0.0, "cam")
    message.is_bigendian, message.step = 1, 8
    padded = np.zeros((2, 8), dtype=np.uint8)
    padded[:, :6] = np.frombuffer(data.tobytes(), np.uint8).reshape(2, 6)
    message.data = padded.tobytes()
    assert_allclose(gray_from_message(message), [[0, 1, 2], [3, 4, 5]])


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8"])
def test_the_brightness_of_a_colour_image_is_its_luma(encoding: str) -> None:
    """By hand, of ITU-R BT.601: 0.299 * 100 + 0.587 * 50 + 0.114 * 10 = 60.39; alpha counts for nothing."""
    colours = dict(zip("rgba", (100, 50, 10, 77), strict=True))
    pixel = [colours[c] for c in encoding[:-1]]
    image = image_message(np.full((2, 3, len(pixel)), pixel, dtype=np.uint8), encoding, 0.0, "cam")
    assert_allclose(gray_from_message(image), np.full((2, 3), 60.39), rtol=1e-6)


def test_a_brightness_that_cannot_be_read_is_no_matter_of_a_colorizer() -> None:
    image = image_message(np.zeros((2, 3, 3), dtype=np.uint16), "rgb16", 0.0, "cam")
    with pytest.raises(SeedError, match=r"encoding 'rgb16' is none of mono16, .*, bgra8$"):
        gray_from_message(image)


def test_images_that_cannot_be_depth_are_refused_with_the_remedy() -> None:
    colour = image_message(np.zeros((4, 5, 3), dtype=np.uint8), "rgb8", 0.0, "cam")
    with pytest.raises(SeedError, match=r"'rgb8' is none of 32FC1, 16UC1, mono16: .* switch the colorizer .* off"):
        depth_from_message(colour, "bubble_left/depth")
    short = image_message(np.zeros((4, 5), dtype=np.float32), "32FC1", 0.0, "cam")
    short.data = short.data[:-4]
    with pytest.raises(SeedError, match=r"bubble_left/depth: 76 bytes with step 20 contradict 5 x 4 32FC1"):
        depth_from_message(short, "bubble_left/depth")
    short.height = 0
    with pytest.raises(SeedError, match="0 pixels"):
        depth_from_message(short, "bubble_left/depth")


def test_brightness_without_a_number_is_black() -> None:
    pixels = np.array([[1.0, np.nan, 3.0], [np.inf, -np.inf, 6.0]], np.float32)
    assert_allclose(gray_from_message(image_message(pixels, "32FC1", 0.0, "camera")), [[1, 0, 3], [0, 0, 6]])
