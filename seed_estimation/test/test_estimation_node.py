# SPDX-License-Identifier: Apache-2.0
"""The estimator as a real node on rendered images: poses that are true, and a reason for whatever is not good."""

from __future__ import annotations

from array import array
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.serialization import serialize_message
from seed_msgs.msg import ContactPatches, RelativePose
from sensor_msgs.msg import CameraInfo, Image, TimeReference
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from seed_core.clocks import save_clocks
from seed_core.errors import SeedError
from seed_core.hand import Hand
from seed_core.spatial import make_pose, pose_from_rpy, rotation_error
from seed_estimation import TactileImages
from seed_estimation.calibration import file as calibration_file
from seed_estimation.calibration.file import Calibration, FingerCalibration
from seed_estimation.images import identity
from seed_estimation.ros import gathering
from seed_estimation.ros.node import EstimatorNode
from seed_ros.conversions import pose_to_matrix, seconds
from seed_ros.images import Intrinsics, camera_info
from seed_ros.images.arrays import image_message
from seed_ros.qos import COMMAND, LATCHED, QUEUE, SENSOR
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros
tactile = pytest.importorskip("seed_sim.tactile", reason="needs the renderer of seed_sim")

PERIOD = 0.04  # [s] between two pictures: leaves time to a busy test machine


@pytest.fixture(scope="module")
def renderer() -> Any:
    return tactile.TactileRenderer(tactile.TactileParameters(), Hand(), seed=4)


class Rig:
    """Two cameras, the estimator and its listeners."""

    def __init__(self, bench: Bench, renderer: Any, **parameters: Any) -> None:
        self.bench, self.renderer = bench, renderer
        self.node = bench.add(EstimatorNode, **parameters)
        self.poses: list[RelativePose] = []
        self.patches: list[ContactPatches] = []
        client = bench.client
        client.create_subscription(RelativePose, "relative_pose", self.poses.append, COMMAND)
        client.create_subscription(ContactPatches, "contact_patches", self.patches.append, COMMAND)
        topics = {"depth": Image, "ir": Image}
        self.streams = {
            (f, k): client.create_publisher(kind, f"bubble_{f}/{k}/image_rect_raw", SENSOR)
            for f in ("left", "right")
            for k, kind in topics.items()
        }
        self.infos = {
            f: client.create_publisher(CameraInfo, f"bubble_{f}/depth/camera_info", SENSOR) for f in ("left", "right")
        }
        self.X_CT: np.ndarray | None = None
        self.hooks: list[Any] = []  # each may change or drop (return None) a message (finger, kind, message)
        self.with_info = True
        self.whose = {"left": "left", "right": "right"}  # bubble whose images each finger's topics carry
        self.spoil_info: Any = lambda _, info: info
        self._next = 0.0
        bench.every.append(self._shoot)
        assert bench.until(lambda: all(s.get_subscription_count() for s in self.streams.values() if self._used(s)))

    def _used(self, stream: Any) -> bool:
        fingers = self.node.inputs.fingers
        return any(f"bubble_{f}" in stream.topic_name for f in fingers)

    def now(self) -> float:
        return self.bench.client.get_clock().now().nanoseconds * 1e-9

    def _shoot(self) -> None:
        t = self.now()
        if t < self._next:
            return
        self._next = t + PERIOD
        images = self.renderer.no_contact(t) if self.X_CT is None else self.renderer.render(self.X_CT, t)
        for finger, whose in self.whose.items():
            self._send(finger, images[whose], t)

    def _send(self, finger: str, pair: TactileImages, t: float) -> None:
        camera = self.renderer.cameras[finger]
        values = Intrinsics(camera.width, camera.height, list(camera.K.ravel()), list(camera.D), camera.model)
        if self.with_info:
            self.infos[finger].publish(self.spoil_info(finger, camera_info(values, t, f"bubble_{finger}_optical")))
        for kind, data, encoding in (("depth", pair.depth, "32FC1"), ("ir", pair.ir, "mono16")):
            array = data if kind == "depth" else np.clip(np.rint(data), 0, 65535).astype(np.uint16)
            message: Any = image_message(array, encoding, t, f"bubble_{finger}_optical")
            for hook in self.hooks:
                message = hook(finger, kind, message) if message is not None else None
            if message is not None:
                self.streams[finger, kind].publish(message)

    def call(self, name: str) -> Any:
        return self.bench.call(Trigger, f"estimator/{name}", Trigger.Request())

    def grasped(self) -> Rig:
        reference = self.call("capture_reference")
        assert reference.success, reference.message
        self.X_CT = np.eye(4)
        self.bench.spin(0.3)
        grasp = self.call("initialize_grasp")
        assert grasp.success, grasp.message
        assert self.bench.until(lambda: self.poses and self.poses[-1].valid)
        return self

    def reason(self, words: str) -> bool:
        """Whether an invalid estimate with these words comes."""
        self.poses.clear()
        return self.bench.until(lambda: any(not p.valid and words in p.reason for p in self.poses), 20.0)


QUICK = {"reference_frames": 6, "grasp_frames": 4, "max_gap": 5.0}


def test_a_moved_tool_is_found_where_it_is_with_the_stamp_of_its_images(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    X = pose_from_rpy(np.deg2rad([2.0, 4.0, -2.0]), [0.0005, 0.0003, 0.002])
    for share in np.linspace(0.1, 1.0, 10):
        rig.X_CT = pose_from_rpy(share * np.deg2rad([2.0, 4.0, -2.0]), share * X[:3, 3])
        bench.spin(2.5 * PERIOD)
    rig.poses.clear()
    assert bench.until(lambda: len(rig.poses) > 5)
    last = rig.poses[-1]
    assert last.valid, last.reason
    error = pose_to_matrix(last.pose.pose)
    assert np.abs(error[:3, 3] - X[:3, 3]).max() < 4e-4  # [m]
    assert np.rad2deg(np.linalg.norm(rotation_error(error[:3, :3], X[:3, :3]))) < 1.5
    assert (last.header.frame_id, last.child_frame_id) == ("compliance", "tool")
    assert 0.0 < rig.now() - (last.header.stamp.sec + 1e-9 * last.header.stamp.nanosec) < 5.0
    assert all(p.in_contact for p in rig.patches[-1].patches)


def test_estimates_carry_the_robots_time_where_the_cameras_clock_is_ahead(
    bench: Bench, renderer: Any, tmp_path: Path
) -> None:
    save_clocks(tmp_path / "clocks.yaml", 0.3, 0.001, "2026-11-22")
    rig = Rig(bench, renderer, clock_offset=0.2, clocks=str(tmp_path / "clocks.yaml"))
    exposed: list[float] = []
    rig.hooks.append(lambda _, __, message: exposed.append(seconds(message.header.stamp)) or message)
    assert bench.until(lambda: len(rig.poses) > 2)
    stamp = seconds(rig.poses[-1].header.stamp)
    assert min(abs(stamp + 0.5 - t) for t in exposed) < 1e-6


@pytest.mark.parametrize("clocks", ["", "one"])
def test_a_grasp_reminds_of_clocks_that_were_never_compared(bench: Bench, renderer: Any, clocks: str) -> None:
    rig = Rig(bench, renderer, clocks=clocks, **QUICK)
    reference = rig.call("capture_reference")
    rig.X_CT = np.eye(4)
    bench.spin(0.3)
    grasp = rig.call("initialize_grasp")
    assert grasp.success, grasp.message
    assert ("never compared with the robot's" in grasp.message) == (not clocks)
    assert "compared" not in reference.message


@pytest.mark.parametrize(
    ("count", "loaded", "z"),
    [(2, "correct", 0.002), (8, "correct", 0.002), (2, "ignore", 0.0), (8, "ignore", 0.0)],
)
def test_a_grasp_taken_anew_is_told_by_invalid_poses_that_no_controller_can_miss(
    bench: Bench, renderer: Any, count: int, loaded: str, z: float
) -> None:
    """It counts from where the tool would be without the load that has dragged it by 2 mm, or from where it is."""
    rig = Rig(bench, renderer, **(QUICK | {"grasp_frames": count, "loaded_grasp": loaded})).grasped()
    rig.X_CT = make_pose(p=(0.0, 0.0, 0.002))
    assert bench.until(lambda: rig.poses[-1].valid and abs(rig.poses[-1].pose.pose.position.z - 0.002) < 5e-4)
    rig.poses.clear()
    assert rig.call("initialize_grasp").success
    assert bench.until(lambda: rig.poses and rig.poses[-1].valid)
    told = [p for p in rig.poses if "a new grasp is taken" in p.reason]
    assert len(told) >= 10
    assert rig.poses[rig.poses.index(told[0]) : -1] == told  # in a row, up to the first pose of the new grasp
    assert not any(p.valid for p in told)
    assert seconds(told[-1].header.stamp) - seconds(told[0].header.stamp) > 0.2
    assert np.abs(pose_to_matrix(rig.poses[-1].pose.pose)[:3, 3] - (0.0, 0.0, z)).max() < 5e-4  # [m]


def test_without_a_reference_or_a_grasp_it_says_so(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK)
    assert rig.reason("no reference")
    early = rig.call("initialize_grasp")
    assert not early.success
    assert "no reference" in early.message
    assert rig.call("capture_reference").success
    assert rig.reason("no grasp")
    empty = rig.call("initialize_grasp")  # the bubbles touch nothing
    assert not empty.success
    assert "touches nothing" in empty.message


def test_no_reference_is_taken_with_a_tool_in_the_grasp(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK)
    push = bench.client.create_publisher(Float64, "gripper/force", QUEUE)
    pushed = 5.0
    bench.every.append(lambda: push.publish(Float64(data=pushed)))
    bench.spin(0.5)
    closed = rig.call("capture_reference")
    assert not closed.success
    assert "it pushes with 5.0 N (reference_push: at most 1 N); open it" in closed.message
    pushed = 0.4  # of its own friction
    bench.spin(0.5)
    rig.grasped()
    seen = rig.call("capture_reference")
    assert not seen.success
    assert "a tool is grasped: it is seen in the bubbles; open the gripper" in seen.message
    rig.X_CT = None
    assert bench.until(lambda: not rig.poses[-1].valid)
    free = rig.call("capture_reference")
    assert free.success, free.message


def test_a_reference_of_many_images_waits_as_long_as_they_come(
    bench: Bench, renderer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gathering, "TIMEOUT", 1.0)  # [s]; 60 images take more than twice as long
    rig = Rig(bench, renderer, reference_frames=60)
    began = rig.now()
    answer = rig.call("capture_reference")
    assert answer.success, answer.message
    assert "taken from 60 images" in answer.message
    assert rig.now() - began > 2.0
    rig.hooks.append(lambda *_: None)
    cut_off = rig.call("capture_reference")
    assert not cut_off.success
    assert "of 60 images came, none for 1 s" in cut_off.message


def test_without_camera_info_it_says_what_is_missing(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK)
    rig.with_info = False
    assert rig.reason("no message on bubble_left/depth/camera_info yet")
    assert min(rig.poses[-1].pose.covariance[::7]) > 1.0, "a pose of which nothing is known is not known exactly"


def cropped(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("left", "depth"):
        message.height -= 10
        message.data = message.data[: message.height * message.step]
    return message


def coloured(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) != ("right", "depth"):
        return message
    picture = np.zeros((message.height, message.width, 3), dtype=np.uint8)
    out = image_message(picture, "rgb8", 0.0, "x")
    out.header = message.header
    return out


def blank(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("left", "depth"):
        message.data = np.full(message.height * message.width, np.nan, np.float32).tobytes()
    return message


def saturated(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("right", "ir"):
        message.data = b"\xff" * len(message.data)
    return message


def truncated(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("left", "ir"):
        message.data = message.data[:-7]
    return message


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (cropped, "image of 224 x 161 pixels; camera_info says 224 x 171"),
        (coloured, "switch the colorizer of the camera driver off"),
        (blank, "only 0% of the depth image"),
        (saturated, "saturated"),
        (truncated, "contradict 224 x 171 mono16"),
    ],
    ids=lambda v: getattr(v, "__name__", ""),
)
def test_bad_images_give_a_reason_and_are_counted_and_good_ones_go_on(
    bench: Bench, renderer: Any, spoil: Any, words: str
) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    rig.hooks.append(spoil)
    assert rig.reason(words), [p.reason for p in rig.poses[-3:]]
    assert rig.node.counters.total() > 0
    rig.hooks.clear()
    assert bench.until(lambda: rig.poses[-1].valid)


def test_a_silent_camera_is_named_and_the_rest_goes_on_when_it_is_back(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    rig.hooks.append(lambda finger, _, message: None if finger == "right" else message)
    assert rig.reason("no image of the right finger")
    rig.hooks.clear()
    assert bench.until(lambda: rig.poses[-1].valid)


def test_after_a_slip_nothing_is_valid_until_the_grasp_is_taken_anew(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, loaded_grasp="ignore", **QUICK).grasped()  # the rendered membranes stay dragged
    rig.node.core._tracker.gross_slip = True  # test_gross.py has slips that raise it
    rig.X_CT = pose_from_rpy((0.0, 0.05, 0.0), (0.001, 0.0, 0.004))
    assert rig.reason("initialize the grasp again")
    bench.spin(5 * PERIOD)
    assert all(p.gross_slip and not p.valid for p in rig.poses[-3:])
    assert rig.call("initialize_grasp").success
    rig.poses.clear()
    assert bench.until(lambda: rig.poses and rig.poses[-1].valid)
    assert not rig.poses[-1].gross_slip
    assert np.abs(pose_to_matrix(rig.poses[-1].pose.pose) - np.eye(4)).max() < 0.002  # T is C where it has slid to


def out_of_step(finger: str, kind: str, message: Image) -> Image:
    if (finger, kind) == ("left", "ir"):
        message.header.stamp.sec -= 10
    return message


def mute(finger: str, kind: str, message: Image) -> Image | None:
    return None if (finger, kind) == ("right", "ir") else message


def left_alone(finger: str, _: str, message: Image) -> Image | None:
    return message if finger == "left" else None


def undated(_: str, __: str, message: Image) -> Image:
    message.header.stamp.sec = message.header.stamp.nanosec = 0
    return message


@pytest.mark.parametrize(
    ("hook", "words"),
    [
        (out_of_step, "are 10.0"),
        (mute, "no images on bubble_right/ir/image_rect_raw"),
        (left_alone, "no images on bubble_right/depth/image_rect_raw"),
        (undated, "images on bubble_left/depth/image_rect_raw are all stamped 0.000 s"),
    ],
    ids=lambda v: getattr(v, "__name__", ""),
)
def test_images_that_never_find_partners_are_explained(bench: Bench, renderer: Any, hook: Any, words: str) -> None:
    rig = Rig(bench, renderer, **QUICK)
    rig.hooks.append(hook)
    assert rig.reason(words), [p.reason for p in rig.poses[-3:]]


def test_a_finger_whose_partner_is_on_its_way_is_not_told_to_be_apart(bench: Bench, renderer: Any) -> None:
    """Depth of an image comes before its infrared: in between, the newest are one period apart."""
    inputs = Rig(bench, renderer, **QUICK).node.inputs
    inputs._latest = {("left", k): deque([1.0, 1.05, 1.1]) for k in ("depth", "ir")}
    inputs._latest["left", "depth"].append(1.15)
    assert inputs._why_unpaired().startswith("no images on bubble_right/depth/image_rect_raw")


def test_a_service_answers_while_a_simulated_clock_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gathering, "TIMEOUT", 0.5)
    bench = Bench()
    try:
        node = bench.add(EstimatorNode, use_sim_time=True)
        answer = bench.call(Trigger, "estimator/initialize_grasp", Trigger.Request())
        assert not answer.success
        assert "0 of 15 images came" in answer.message
        assert "a cell that has only just started needs some seconds" in answer.message
        node.gathering._started -= 20.0  # [s]
        assert "only just started" not in bench.call(Trigger, "estimator/initialize_grasp", Trigger.Request()).message
    finally:
        bench.close()


def test_cameras_that_never_come_are_told_by_the_names_that_they_should_have() -> None:
    bench = Bench()
    try:
        remaps = ["--ros-args", "-r", "bubble_left/depth/image_rect_raw:=/bubble_1/depth/image_rect_raw"]
        node = bench.add(lambda **given: EstimatorNode(cli_args=remaps, **given))
        assert bench.until(lambda: "no images at all" in node.counters.last, 10.0)
        assert "bubble_1/depth/image_rect_raw" in node.counters.last
    finally:
        bench.close()


def as_another_camera_sends_it(kind: np.dtype, encoding: str, big: int, padding: int) -> Any:
    """A hook: values of every image of one sort in another encoding, byte order and length of rows."""
    depth = encoding == "16UC1"

    def changed(_: str, what: str, message: Image) -> Image:
        if (what == "depth") != depth:
            return message
        pixels = np.frombuffer(bytes(message.data), np.float32 if depth else np.uint16)
        values = np.nan_to_num(pixels * 1e3 if depth else pixels / (16.0 if kind.itemsize == 1 else 1.0))
        rows = values.reshape(message.height, message.width).astype(kind).view(np.uint8)
        message.data = np.pad(rows, ((0, 0), (0, padding))).tobytes()
        message.encoding, message.is_bigendian, message.step = encoding, big, rows.shape[1] + padding
        return message

    return changed


def test_whatever_way_a_camera_sends_its_pixels_the_tool_is_found(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    for form in (
        (np.dtype("<u2"), "16UC1", 0, 0),
        (np.dtype(">u2"), "16UC1", 1, 6),
        (np.dtype(">u2"), "mono16", 1, 2),
        (np.dtype("u1"), "mono8", 0, 3),
    ):
        rig.hooks[:] = [as_another_camera_sends_it(*form)]
        bench.spin(3 * PERIOD)
        assert rig.call("initialize_grasp").success
        rig.poses.clear()
        assert bench.until(lambda: len(rig.poses) > 2)
        assert rig.poses[-1].valid, (form, rig.poses[-1].reason)
        assert np.abs(pose_to_matrix(rig.poses[-1].pose.pose) - np.eye(4)).max() < 0.01


def test_one_finger_alone_works_when_it_is_configured(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, fingers="left", **QUICK).grasped()
    assert rig.poses[-1].valid
    assert [p.finger for p in rig.patches[-1].patches] == ["left"]


def test_the_method_changes_live_and_nonsense_is_refused(bench: Bench, renderer: Any) -> None:
    from rclpy.parameter import Parameter

    rig = Rig(bench, renderer, **QUICK).grasped()
    refused = rig.node.set_parameters([Parameter("threshold", value=5.0)])[0]
    assert not refused.successful
    assert "threshold = 5 m must be within" in refused.reason
    assert rig.node.set_parameters([Parameter("method", value="published")])[0].successful
    assert rig.reason("no grasp")
    assert rig.call("initialize_grasp").success
    assert bench.until(lambda: rig.poses[-1].valid and rig.poses[-1].method == "published")


def test_the_cameras_frames_are_those_of_the_calibration_which_counts_from_the_start(
    bench: Bench, renderer: Any, tmp_path: Path
) -> None:
    from rclpy.parameter import Parameter

    fingers = {}
    for finger, drawn, y in (("left", Hand().C_L, 0.1), ("right", Hand().C_R, -0.1)):
        camera = renderer.cameras[finger]
        found = replace(drawn, position=(0.0, y, 0.0))
        fingers[finger] = FingerCalibration(camera.width, camera.height, pose=found, drawn=drawn)
    file = tmp_path / "calibration.yaml"
    calibration_file.save(Calibration(fingers, 0.001, 0.0001), file)
    frames: dict[str, float] = {}

    def heard(message: TFMessage) -> None:
        frames.update({t.child_frame_id: t.transform.translation.y for t in message.transforms})

    bench.client.create_subscription(TFMessage, "/tf_static", heard, LATCHED)
    rig = Rig(bench, renderer, calibration=str(file), **QUICK)
    assert bench.until(lambda: "bubble_left_optical" in frames)
    assert frames["bubble_left_optical"] == pytest.approx(0.1)
    assert frames["bubble_right_optical"] == pytest.approx(-0.1)
    assert bench.until(lambda: rig.node.core is not None)
    np.testing.assert_allclose(rig.node.core.hand.X_CL[:3, 3], (0.0, 0.1, 0.0), atol=1e-12)
    refused = rig.node.set_parameters([Parameter("calibration", value="")])[0]
    assert not refused.successful
    with pytest.raises(SeedError, match=r"nothing.yaml: cannot be read"):
        bench.add(EstimatorNode, calibration=str(tmp_path / "nothing.yaml"))


def test_it_answers_what_time_it_is_and_what_it_takes_off(bench: Bench, tmp_path: Path) -> None:
    save_clocks(tmp_path / "clocks.yaml", 0.0123, 0.0004, "2026-11-22")
    bench.add(EstimatorNode, clocks=str(tmp_path / "clocks.yaml"))
    answers: list[TimeReference] = []
    bench.client.create_subscription(TimeReference, "clock_answer", answers.append, COMMAND)
    questions = bench.client.create_publisher(TimeReference, "clock_question", COMMAND)
    question = TimeReference()
    question.header.stamp = bench.client.get_clock().now().to_msg()
    bench.every.append(lambda: questions.publish(question))
    assert bench.until(lambda: answers)
    assert answers[0].time_ref == question.header.stamp
    assert float(answers[0].source) == 0.0123
    assert 0.0 < seconds(answers[0].header.stamp) - seconds(question.header.stamp) < 30.0


def test_a_clock_of_the_cameras_that_is_set_back_is_gone_along_with(bench: Bench, renderer: Any) -> None:
    """The poses keep the images' stamps, so that whoever uses them sees that they are of another time."""
    rig = Rig(bench, renderer, **QUICK).grasped()
    before = seconds(rig.poses[-1].header.stamp)

    def late(_: str, __: str, message: Image) -> Image:
        message.header.stamp.sec -= 100
        return message

    rig.hooks.append(late)
    assert bench.until(lambda: seconds(rig.poses[-1].header.stamp) < before - 90.0 and rig.poses[-1].valid)
    rig.hooks.clear()
    assert bench.until(lambda: seconds(rig.poses[-1].header.stamp) > before and rig.poses[-1].valid)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("k", [0.0] * 9, "bubble_right/depth/camera_info"),
        ("k", [float("nan")] * 9, "bubble_right/depth/camera_info"),
        ("distortion_model", "fisheye", "fisheye"),
        ("width", 640, "camera_info says 640 x 171"),
    ],
)
def test_a_camera_info_that_contradicts_the_image_is_named(
    bench: Bench, renderer: Any, name: str, value: Any, words: str
) -> None:
    rig = Rig(bench, renderer, **QUICK)

    def spoilt(finger: str, info: CameraInfo) -> CameraInfo:
        if finger == "right":
            setattr(info, name, value)
        return info

    rig.spoil_info = spoilt
    assert rig.reason(words), [p.reason for p in rig.poses[-3:]]


def test_a_camera_info_that_is_refused_is_told_until_a_good_one_of_the_same_finger_comes(
    bench: Bench, renderer: Any
) -> None:
    """The left camera's loses its focal length; the right one's stays good."""
    rig = Rig(bench, renderer, **QUICK)
    refused = "bubble_left/depth/camera_info: "

    def spoilt(finger: str, info: CameraInfo) -> CameraInfo:
        if finger == "left":
            info.k = [0.0] * 9
        return info

    rig.spoil_info = spoilt
    assert rig.reason(refused), [p.reason for p in rig.poses[-3:]]
    rig.poses.clear()
    assert bench.until(lambda: len(rig.poses) > 5)
    assert all(refused in p.reason for p in rig.poses), [p.reason for p in rig.poses]
    rig.spoil_info = lambda _, info: info
    rig.grasped()
    rig.spoil_info = spoilt
    assert rig.reason(refused), [p.reason for p in rig.poses[-3:]]
    rig.poses.clear()
    assert bench.until(lambda: len(rig.poses) > 5)
    assert not any(p.valid for p in rig.poses)
    rig.spoil_info = lambda _, info: info
    assert rig.reason("no reference")


# whose images are these?


def known(renderer: Any, file: Path, **frame_ids: str) -> str:
    """A file that says what each bubble looks like; its name."""
    identity.save(
        file,
        {
            finger: identity.Known(
                identity.pattern(images.ir), frame_ids.get(finger, "optical"), renderer.cameras[finger].K
            )
            for finger, images in renderer.no_contact(0.0).items()
        },
    )
    return str(file)


def half_turned(_: str, __: str, message: Image) -> Image:
    kind = np.float32 if message.encoding == "32FC1" else np.uint16
    pixels = np.frombuffer(bytes(message.data), kind)
    message.data = pixels[::-1].tobytes()
    return message


def test_swapped_and_turned_cameras_are_told_by_their_saved_dots(bench: Bench, renderer: Any, tmp_path: Path) -> None:
    rig = Rig(bench, renderer, identity_file=known(renderer, tmp_path / "bubbles.npz"), **QUICK)
    rig.whose = {"left": "right", "right": "left"}
    swapped = rig.call("capture_reference")
    assert not swapped.success
    assert "left and right are swapped" in swapped.message
    rig.whose = {"left": "left", "right": "right"}
    rig.hooks.append(half_turned)
    bench.spin(3 * PERIOD)
    turned = rig.call("capture_reference")
    assert not turned.success
    assert "rotated by 180 degrees" in turned.message
    rig.hooks.clear()
    bench.spin(3 * PERIOD)
    right = rig.call("capture_reference")
    assert right.success
    assert "verified by dots" in right.message


def test_a_camera_with_the_other_finger_s_intrinsics_is_refused(bench: Bench, renderer: Any, tmp_path: Path) -> None:
    file = tmp_path / "bubbles.npz"
    known(renderer, file)
    lenses = identity.load(file)
    moved = {f: bubble._replace(K=bubble.K + (f == "right") * np.eye(3)) for f, bubble in lenses.items()}
    identity.save(file, moved)
    rig = Rig(bench, renderer, identity_file=str(file), **QUICK)  # the right camera now has the left one's lens
    assert rig.reason("has the left camera's intrinsics: left and right are swapped")


def test_a_frame_id_of_the_other_camera_is_refused(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK)

    def crossed(finger: str, _: str, message: Image) -> Image:
        other = "right" if finger == "left" else "left"
        message.header.frame_id = f"bubble_{other}_optical"
        return message

    rig.hooks.append(crossed)
    assert rig.reason("left and right are swapped")


def test_bubbles_that_nothing_tells_apart_are_reported_unverified(bench: Bench, renderer: Any, tmp_path: Path) -> None:
    file = tmp_path / "written.npz"
    rig = Rig(bench, renderer, identity_file=str(file), **QUICK)

    def anonymous(_: str, __: str, message: Image) -> Image:
        message.header.frame_id = "camera"
        return message

    rig.hooks.append(anonymous)
    rig.grasped()
    assert "unverified" in rig.poses[-1].reason
    assert identity.load(file)["left"].frame_id == "camera"  # the next session will know


# whatever comes in

STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
VALUES = st.sampled_from((np.nan, np.inf, -np.inf, -1.0, 0.0, 1e-30, 0.08, 0.2, 900.0, 65535.0, 1e30))


@st.composite
def any_image(draw: st.DrawFn) -> tuple[str, str, Image]:
    """A finger, a kind of image, and an image that may be whatever a faulty driver sends."""
    finger, kind = draw(st.sampled_from(("left", "right"))), draw(st.sampled_from(("depth", "ir")))
    encoding = draw(st.sampled_from(("32FC1", "16UC1", "mono16", "mono8", "rgb8", "64FC1", "")))
    w, h = draw(st.sampled_from(((224, 171), (171, 224), (1, 1), (0, 0), (64, 48), (100000, 100000))))
    size = {"32FC1": 4, "16UC1": 2, "mono16": 2, "rgb8": 3}.get(encoding, 1)
    message = Image(width=w, height=h, encoding=encoding, step=draw(st.sampled_from((w * size, 0, w * size + 3))))
    message.is_bigendian = draw(st.integers(0, 1))
    count = min(message.step * h, 300000)
    values = np.full(count // size + 1, draw(VALUES))
    values[:: draw(st.integers(1, 50))] = draw(VALUES)
    with np.errstate(invalid="ignore", over="ignore"):
        data = values.astype(np.float32 if size == 4 else np.uint16 if size == 2 else np.uint8).tobytes()
    message.data = array("B", data[: max(0, count + draw(st.sampled_from((0, 0, 0, -1, 7))))])
    message.header.stamp.sec, message.header.stamp.nanosec = draw(STAMPS)
    return finger, kind, message


def test_whatever_images_come_the_node_lives_and_answers_with_reasons(bench: Bench, renderer: Any) -> None:
    rig = Rig(bench, renderer, **QUICK).grasped()
    node = rig.node
    told: list[Any] = []
    publish = node._publish

    def noted(estimate: Any) -> None:
        told.append(estimate)
        publish(estimate)

    node._publish = noted

    @settings(max_examples=120, deadline=None, database=None, derandomize=True)
    @given(st.lists(any_image(), min_size=1, max_size=4), st.integers(0, 2**31 - 1))
    def feed(images: list[tuple[str, str, Image]], second: int) -> None:
        for finger, kind, message in images:
            node.inputs._on_image(finger, kind, serialize_message(message), {})
        for finger in ("left", "right"):  # and whole sets of what does not fit together
            for kind in ("depth", "ir"):
                message = images[len(finger + kind) % len(images)][2]
                message.header.stamp.sec, message.header.stamp.nanosec = second, 0
                node.inputs._on_image(finger, kind, serialize_message(message), {})

    feed()
    assert len(told) > 20
    for estimate in told:
        assert np.isfinite(estimate.X_CT).all()
        assert np.isfinite(estimate.covariance).all()
        assert estimate.valid or estimate.reason
    node._publish = publish
    node.core._stamp = -np.inf  # the clock of the fuzz may have run ahead of this one
    for pairing in (*node.inputs._images.values(), node.inputs._both):
        pairing.clear()
        pairing._newest = dict.fromkeys(pairing._newest, -np.inf)
    assert bench.until(lambda: rig.poses[-1].valid), rig.poses[-1].reason
