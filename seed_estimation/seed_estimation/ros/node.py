# SPDX-License-Identifier: Apache-2.0
"""The estimator's ROS node: images in, pose of the tool in the grasp out."""

from __future__ import annotations

import sys
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from seed_msgs.msg import ContactPatch as PatchMsg
from seed_msgs.msg import ContactPatches, RelativePose
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand
from seed_core.regrasp import Regrasp
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.estimator import Estimator
from seed_estimation.images import identity
from seed_estimation.images.tactile_images import TactileImages
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.ros.inputs import ImageInputs, InputSettings
from seed_ros import diagnostics
from seed_ros.conversions import estimate_to_message, stamp_from_seconds, transform_stamped
from seed_ros.diagnostics import Counters
from seed_ros.frames import FrameNames
from seed_ros.images.arrays import image_message
from seed_ros.loop import FixedRateLoop
from seed_ros.node import QUIET, TransformBroadcaster, run
from seed_ros.parameters import declare, refuse_unknown
from seed_ros.qos import COMMAND, SENSOR

LOOP_RATE = 20.0  # [Hz] at which it is looked for anything but images, which wake the node
LATENCIES = 450  # of the last ten seconds, for the percentiles in diagnostics: from image stamp to images, to estimate
COLLECT_TIMEOUT = 6.0  # [s] for the images of a reference or a grasp
REMINDER = (
    "the cameras' clock was never compared with the robot's: do so before pressing on anything (a live identification "
    "tells the offset), then set clock_offset and clock_compared"
)


@dataclass(frozen=True)
class NodeSettings:
    """What is the node's alone."""

    reference_frames: int = field(15, low=1, high=500, doc="images averaged by ~/capture_reference")
    grasp_frames: int = field(8, low=1, high=500, doc="images averaged by ~/initialize_grasp")
    identity_file: str = field(
        "", doc="what tells the bubbles apart, from one session to the next; written by the first reference"
    )
    realtime_priority: int = field(
        20, low=0, high=98, doc="SCHED_FIFO priority if allowed, below the controller's; 0: none"
    )
    publish_tf: bool = field(True, doc="publish compliance to tool on /tf, and the hand's frames on /tf_static")


class _Collection:
    """Images gathered for a service that waits for them."""

    def __init__(self, what: str, count: int, deadline: float) -> None:
        self.what, self.count, self.deadline = what, count, deadline
        self.frames: list[dict[str, TactileImages]] = []
        self.future: Future = Future()


class EstimatorNode(Node):
    """See docs/interfaces.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("estimator", **arguments)
        cv2.setNumThreads(1)
        self.settings = declare(self, NodeSettings())
        inputs = declare(self, InputSettings())
        self.frames = declare(self, FrameNames(), "frames")
        self.hand = declare(self, Hand(), "hand")
        live = tuple(EstimatorParameters.__dataclass_fields__)
        self.parameters = declare(self, EstimatorParameters(), live=live, on_change=self._on_parameters)
        refuse_unknown(self, shared=("tool.", "grasp."))
        self.counters = Counters(self)
        self.core: Estimator | None = None
        self._collection: _Collection | None = None
        self._regrasp = Regrasp()
        self._answer: tuple[_Collection, bool, str] | None = None  # given once poses may be used again
        self._latencies: deque[tuple[float, float]] = deque(maxlen=LATENCIES)
        self._last: RelativePoseEstimate | None = None
        self._poses = self.create_publisher(RelativePose, "relative_pose", COMMAND, event_callbacks=QUIET)
        self._patches = self.create_publisher(ContactPatches, "contact_patches", COMMAND, event_callbacks=QUIET)
        self._debug = self.create_publisher(Image, "~/debug_image", SENSOR, event_callbacks=QUIET)
        self._tf = TransformBroadcaster(self)
        priority = self.settings.realtime_priority
        self.loop = FixedRateLoop(self, LOOP_RATE, lambda: None, steady=True, eager=True, priority=priority)
        self.inputs = ImageInputs(self.loop, inputs, self.counters, self._now, self._on_images, self._publish_invalid)
        self.inputs.on_calibration = self._restart
        names = {finger: self.frames.camera(finger) for finger in self.inputs.fingers}
        self.bubbles = self.inputs.bubbles = identity.Bubbles(self.settings.identity_file, names)
        waiting = ReentrantCallbackGroup()  # these answer later, and images must come in meanwhile
        self.create_service(Trigger, "~/capture_reference", self._capture_reference, callback_group=waiting)
        self.create_service(Trigger, "~/initialize_grasp", self._initialize_grasp, callback_group=waiting)
        self.create_timer(0.1, self._watch)
        self._diagnostics = diagnostics.Diagnostics(self, "estimator", self._report)
        self._publish_hand()

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds * 1e-9)

    # the core
    def _restart(self) -> None:
        """A camera became known, or is another one now: start again, without a reference."""
        if not self.inputs.calibrated:
            return
        if self.core is not None:
            self.counters.add("camera_changed", "camera_info has changed: capture the reference again")
        try:
            self.core = Estimator(self.parameters, self.hand, dict(self.inputs.cameras))
            self.core.patterns.update({f: known.pattern for f, known in self.bubbles.known.items()})
        except SeedError as error:
            self.core = None
            self.counters.add("camera_info_refused", str(error))
            self.inputs.camera_problem = str(error)

    def _on_parameters(self, parameters: EstimatorParameters) -> None:
        self.parameters = parameters
        if self.core is not None:
            self.core.reconfigure(parameters)

    def _on_images(self, stamp: float, images: dict[str, TactileImages]) -> None:
        if self.core is None:
            self._publish_invalid(stamp, self.inputs.camera_problem or "the estimator is not set up")
            return
        if self._collection is not None and self._collect(images):
            return  # a new reference or grasp begins with the next images
        estimate = self.core.update(images, stamp)
        if not estimate.valid:
            self.counters.add("estimates_invalid", estimate.reason)
        elif self.bubbles.status == identity.Bubbles.UNVERIFIED:
            doubt = "which bubble is which, and which way is up, is unverified"
            estimate = replace(estimate, reason="; ".join(filter(None, (estimate.reason, doubt))))
        self._publish(self._regrasp.through(estimate))
        if self._answer is not None and not self._regrasp.under_way:
            self._give_answer()
        self._publish_patches(stamp)
        if self._debug.get_subscription_count():
            self._debug.publish(image_message(self.core.debug_image(), "bgr8", stamp, self.frames.compliance))

    # out
    def _publish(self, estimate: RelativePoseEstimate) -> None:
        self._last = estimate
        self._poses.publish(estimate_to_message(estimate, self.frames.compliance, self.frames.tool))
        self._latencies.append((self.inputs.arrived - estimate.stamp, self._now() - estimate.stamp))
        if estimate.valid and self.settings.publish_tf:
            self._tf.send(transform_stamped(estimate.X_CT, estimate.stamp, self.frames.compliance, self.frames.tool))

    def _publish_invalid(self, stamp: float, reason: str) -> None:
        unseen = (False,) * 6
        self._publish(
            RelativePoseEstimate(
                stamp, np.eye(4), observed=unseen, valid=False, reason=reason, method=self.parameters.method
            )
        )

    def _publish_patches(self, stamp: float) -> None:
        assert self.core is not None
        if not self.core.patches:
            return
        message = ContactPatches(patches=[_patch_message(p) for p in self.core.patches.values()])
        message.header.stamp = stamp_from_seconds(stamp)
        message.header.frame_id = self.frames.compliance
        self._patches.publish(message)

    def _publish_hand(self) -> None:
        if not self.settings.publish_tf:
            return
        t, f, hand = self._now(), self.frames, self.hand
        self._tf.send_static(
            transform_stamped(hand.X_EC, t, f.flange, f.compliance),
            transform_stamped(hand.X_CL, t, f.compliance, f.left_camera),
            transform_stamped(hand.X_CR, t, f.compliance, f.right_camera),
        )

    # services
    async def _capture_reference(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return await self._gather("reference", self.settings.reference_frames, response)

    async def _initialize_grasp(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response = await self._gather("grasp", self.settings.grasp_frames, response)
        if response.success and not self.inputs.settings.clock_compared:
            self.get_logger().warning(REMINDER, once=True)
            response.message += f"; {REMINDER}"
        return response

    async def _gather(self, what: str, count: int, response: Trigger.Response) -> Trigger.Response:
        before = self._collection or (self._answer and self._answer[0])
        if before:
            response.success, response.message = False, f"still gathering images for the {before.what}"
            return response
        self._collection = collection = _Collection(what, count, self._now() + COLLECT_TIMEOUT)
        self._regrasp.begin(what)  # already now: a controller that presses has to hold before T := C
        response.success, response.message = await collection.future
        if response.success:  # rclpy wants one severity per line of code
            self.get_logger().info(f"{what}: {response.message}")
        else:
            self.get_logger().error(f"{what}: {response.message}")
        return response

    def _collect(self, images: dict[str, TactileImages]) -> bool:
        """Keep the images for the service that waits; whether that was the last of them."""
        collection = self._collection
        assert collection is not None
        assert self.core is not None
        if set(images) == set(self.inputs.fingers):
            collection.frames.append(images)
        if len(collection.frames) < collection.count:
            return False
        use = self.core.capture_reference if collection.what == "reference" else self.core.initialize_grasp
        try:
            use(collection.frames)
        except SeedError as error:
            self._finish(collection, False, str(error))
            return True
        if collection.what == "reference":
            self._identify()
        words = f"taken from {len(collection.frames)} images of each finger; the bubbles are {self.bubbles.status}"
        self._finish(collection, True, words)
        return True

    def _finish(self, collection: _Collection, success: bool, words: str) -> None:
        """The images are there, or never will be; the answer waits until a controller may be enabled on the poses."""
        self._collection, self._answer = None, (collection, success, words)
        self._regrasp.end()

    def _give_answer(self) -> None:
        assert self._answer is not None
        (collection, success, words), self._answer = self._answer, None
        collection.future.set_result((success, words))

    def _identify(self) -> None:
        """Whose images made the new reference?"""
        assert self.core is not None
        patterns, names, cameras = self.core.patterns, self.inputs.frame_ids, self.inputs.cameras
        seen = {f: identity.Known(patterns[f], names[f], cameras[f].K) for f in self.inputs.fingers}
        try:
            self.bubbles.judge(seen)
        except SeedError as error:
            self.counters.add("identity_not_saved", str(error))

    def _watch(self) -> None:
        """Give up on a service whose images do not come, and say why images are of no use."""
        self.inputs.watch()
        collection = self._collection
        if collection is not None and self._now() > collection.deadline:
            why = self.counters.last or "no images arrive on bubble_left/... and bubble_right/..."
            got = f"{len(collection.frames)} of {collection.count} images within {COLLECT_TIMEOUT:g} s"
            self._finish(collection, False, f"{got}; {why}")
        if self._answer is not None and self._now() > self._answer[0].deadline:  # no images any more
            self._give_answer()

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {"method": self.parameters.method, **self.inputs.counts()}
        values["identity"] = self.bubbles.status
        values["clock_compared"] = self.inputs.settings.clock_compared
        values |= self.counters.values()
        if self._latencies:
            for name, ms in zip(("arrival", "latency"), 1e3 * np.array(self._latencies).T, strict=True):
                p50, p99 = np.percentile(ms, (50, 99))
                values |= {f"{name}_p50_ms": round(float(p50), 2), f"{name}_p99_ms": round(float(p99), 2)}
        if self._last is None:
            return diagnostics.STALE, "no images yet", values
        if not self._last.valid:
            return diagnostics.WARN, self._last.reason, values
        return diagnostics.OK, self._last.reason or "tracking", values


def _patch_message(patch: ContactPatch) -> PatchMsg:
    message = PatchMsg(finger=patch.finger, in_contact=bool(patch.in_contact), pixels=int(patch.pixels))
    message.area = float(patch.area)
    message.mean_indentation = float(patch.mean_indentation)
    message.max_indentation = float(patch.max_indentation)
    for point, p in ((message.centroid, patch.centroid), (message.centroid_in_hand, patch.centroid_C)):
        point.x, point.y, point.z = (float(v) for v in p)
    return message


def main() -> None:
    """Run the node until it is interrupted."""
    sys.exit(run(EstimatorNode))


if __name__ == "__main__":
    main()
