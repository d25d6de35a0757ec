# SPDX-License-Identifier: Apache-2.0
"""The estimator's ROS node: images in, pose of the tool in the grasp out."""

import time
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from seed_msgs.msg import ContactPatch as PatchMsg
from seed_msgs.msg import ContactPatches, RelativePose
from sensor_msgs.msg import Image, TimeReference
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import FINGERS_OF, Hand
from seed_estimation.calibration import file as calibration_file
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.estimator import Estimator
from seed_estimation.images import identity
from seed_estimation.images.tactile_images import TactileImages
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.report import invalid
from seed_estimation.ros.gathering import Gathering, GatheringError, Images
from seed_estimation.ros.inputs import ImageInputs, InputSettings
from seed_ros import COMMAND, QUEUE, SENSOR, FixedRateLoop, FrameNames, SeedNode, TransformBroadcaster, diagnostics
from seed_ros.conversions import estimate_to_message, fill, stamped, transform_stamped
from seed_ros.images import image_message

LOOP_RATE = 20.0  # [Hz] at which it is looked for anything but images, which wake the node
PUSH_AGE = 1.0  # [s] for which a gripper's push counts
LATENCIES = 450  # of the last ten seconds, for the percentiles in diagnostics: from image stamp to images, to estimate
DEBUG_PERIOD = 0.06  # [s] between two debug images: one for each picture of the operator page, which has 12 a second


@dataclass(frozen=True)
class NodeSettings:
    """What is the node's alone."""

    reference_frames: int = field(15, low=2, high=500, doc="images averaged by ~/capture_reference")
    reference_push: float = field(
        1.0, unit="N", low=0.0, high=100.0, doc="push of a finger from which ~/capture_reference is refused; 0: never"
    )
    grasp_frames: int = field(15, low=2, high=500, doc="images averaged by ~/initialize_grasp")
    identity_file: str = field(
        "",
        doc="what tells the bubbles apart, from one session to the next; written by the first reference of each bubble",
    )
    realtime_priority: int = field(
        20, low=0, high=98, doc="SCHED_FIFO priority if allowed, below the controller's; 0: none"
    )
    publish_tf: bool = field(True, doc="publish compliance to tool on /tf, and the hand's frames on /tf_static")


class EstimatorNode(SeedNode):
    """See docs/interfaces.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("estimator", **arguments)
        cv2.setNumThreads(1)
        self.settings = self.declare(NodeSettings())
        inputs = self.declare(InputSettings())
        self.frames = self.declare(FrameNames(), "frames")
        self.drawn = self.declare(Hand(), "hand")
        live = set(EstimatorParameters.__dataclass_fields__) - {"calibration"}
        self.parameters = self.declare(EstimatorParameters(), live=live, on_change=self._on_parameters)
        self.calibration = calibration_file.load(self.parameters.calibration)
        self.hand = self.calibration.hand(self.drawn)
        self.refuse_unknown(shared=("tool.", "grasp."))

        self.core: Estimator | None = None
        self._no_core = ""  # why there is none although the cameras are known
        names = {finger: self.frames.camera(finger) for finger in FINGERS_OF[inputs.fingers]}
        self.bubbles = identity.KnownBubbles(self.settings.identity_file, names)
        self.gathering = Gathering(self)
        self._arrivals: deque[float] = deque(maxlen=LATENCIES)
        self._latencies: deque[float] = deque(maxlen=LATENCIES)
        self._last: RelativePoseEstimate | None = None

        self._poses = self.publisher(RelativePose, "relative_pose", COMMAND)
        self._patches = self.publisher(ContactPatches, "contact_patches", COMMAND)
        self._next_debug = 0.0  # [s]
        self._debug = self.publisher(Image, "~/debug_image", SENSOR)
        self._tf = TransformBroadcaster(self)
        if self.settings.publish_tf:
            self._publish_hand()

        priority = self.settings.realtime_priority
        self.loop = FixedRateLoop(self, LOOP_RATE, lambda: None, steady=True, eager=True, priority=priority)
        self.inputs = ImageInputs(self, inputs, self.bubbles, self._on_images, self._publish_invalid, self._restart)
        self.create_timer(0.1, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._clock_answers = self.publisher(TimeReference, "clock_answer", COMMAND)
        self.loop.poll(TimeReference, "clock_question", self._on_clock_question, COMMAND)

        self._push = 0.0, -np.inf  # [N] of each finger, and when it was told [s] by the machine's clock
        self.loop.poll(Float64, "gripper/force", self._on_push, QUEUE)

        waiting = ReentrantCallbackGroup()  # these answer later, and images must come in meanwhile
        self.serve(Trigger, "~/capture_reference", self._capture_reference, group=waiting)
        self.serve(Trigger, "~/initialize_grasp", self._initialize_grasp, group=waiting)
        self.diagnose("estimator", self._report)

    # the core
    def _restart(self) -> None:
        """A camera became known, or is another one now: start again, without a reference."""
        if self.core is not None:
            self.counters.add("camera_changed", "camera_info has changed: capture the reference again")
        try:
            patterns = {f: known.pattern for f, known in self.bubbles.known.items()}
            cameras, calibration = self.inputs.cameras, self.calibration
            self.core = Estimator(self.parameters, self.drawn, cameras, calibration, patterns)
        except SeedError as error:
            self.core, self._no_core = None, str(error)
            self.counters.add("camera_info_refused", self._no_core)

    def _on_parameters(self, parameters: EstimatorParameters) -> None:
        self.parameters = parameters
        if self.core is not None:
            self.core.reconfigure(parameters)

    def _on_images(self, stamp: float, images: dict[str, TactileImages]) -> None:
        if self.core is None:
            self._publish_invalid(stamp, self._no_core)
            return
        if set(images) == set(self.inputs.fingers) and self.gathering.add(images):
            return  # a new reference or grasp begins with the next images
        estimate = self.core.update(images, stamp)
        if not estimate.valid:
            self.counters.add("estimates_invalid", estimate.reason)
        elif self.bubbles.status == identity.KnownBubbles.UNVERIFIED:
            doubt = "which bubble is which, and which way is up, is unverified"
            estimate = replace(estimate, reason="; ".join(filter(None, (estimate.reason, doubt))))
        self._publish(self.gathering.through(estimate))
        self._publish_patches(stamp)
        if stamp >= self._next_debug or stamp < self._next_debug - 1.0:  # or time was set back
            self._next_debug = stamp + DEBUG_PERIOD
            self._publish_debug(stamp)

    def _publish_debug(self, stamp: float) -> None:
        """Drawn only for somebody who looks, and after what the loop waits for."""
        if self.core is not None and self._debug.get_subscription_count():
            self._debug.publish(image_message(self.core.debug_image(), "bgr8", stamp, self.frames.compliance))

    def _on_clock_question(self, message: TimeReference) -> None:
        """What time it is here, and by which offset [s] stamps are mended: the controller may run elsewhere."""
        answer = stamped(TimeReference, self.now(), "")
        answer.time_ref = message.header.stamp
        answer.source = f"{self.inputs.clocks.offset:.6f}"
        self._clock_answers.publish(answer)

    def _on_push(self, message: Float64) -> None:
        self._push = message.data, time.monotonic()

    # out
    def _publish(self, estimate: RelativePoseEstimate) -> None:
        self._last = estimate
        self._poses.publish(estimate_to_message(estimate, self.frames.compliance, self.frames.tool))
        self._arrivals.append(self.inputs.arrived - estimate.stamp)
        self._latencies.append(self.now() - estimate.stamp)
        self.beats.add(self._latencies[-1])
        if estimate.valid and self.settings.publish_tf:
            self._tf.send(transform_stamped(estimate.X_CT, estimate.stamp, self.frames.compliance, self.frames.tool))

    def _publish_invalid(self, stamp: float, reason: str) -> None:
        self._publish(invalid(stamp, reason, self.parameters.method))

    def _publish_patches(self, stamp: float) -> None:
        assert self.core is not None
        if not self.core.patches:
            return
        message = stamped(ContactPatches, stamp, self.frames.compliance)
        message.patches = [_patch_message(p) for p in self.core.patches.values()]
        self._patches.publish(message)

    def _publish_hand(self) -> None:
        t, f, hand = self.now(), self.frames, self.hand
        self._tf.send_static(
            transform_stamped(hand.X_EC, t, f.flange, f.compliance),
            transform_stamped(hand.X_CL, t, f.compliance, f.left_camera),
            transform_stamped(hand.X_CR, t, f.compliance, f.right_camera),
        )

    # services
    def _refuse_grasped(self) -> None:
        """What touches the bubbles would be taken for a part of them."""
        push, told = self._push
        if time.monotonic() - told < PUSH_AGE and push > (self.settings.reference_push or np.inf):
            raise GatheringError(
                f"the gripper is closed on something: it pushes with {push:.1f} N (reference_push: at most "
                f"{self.settings.reference_push:g} N); open it, for the bubbles must touch nothing"
            )
        if self._last is not None and self._last.valid:
            raise GatheringError("a tool is grasped: it is seen in the bubbles; open the gripper, and call again")

    async def _capture_reference(self) -> str:
        self._refuse_grasped()
        return await self.gathering.gather("reference", self.settings.reference_frames, self._use_reference)

    async def _initialize_grasp(self) -> str:
        words = await self.gathering.gather("grasp", self.settings.grasp_frames, self._use_grasp)
        reminder = self.inputs.clocks.problem
        if not reminder:
            return words
        self.get_logger().warning(reminder, once=True)
        return f"{words}; {reminder}"

    def _use_reference(self, images: list[Images]) -> str:
        assert self.core is not None
        self.core.capture_reference(images)
        patterns, names, cameras = self.core.patterns, self.inputs.frame_ids, self.inputs.cameras
        with self.counters.refusing("identity_not_saved"):
            self.bubbles.judge({f: identity.Known(patterns[f], names[f], cameras[f].K) for f in self.inputs.fingers})
        return self._taken(images)

    def _use_grasp(self, images: list[Images]) -> str:
        assert self.core is not None
        self.core.initialize_grasp(images)
        zero = self.core.zero
        doubt = f"{zero.words}; deflections count from where it would be free" if zero.loaded else zero.words
        return "; ".join(filter(None, (self._taken(images), doubt)))

    def _taken(self, images: list[Images]) -> str:
        return f"taken from {len(images)} images of each finger; the bubbles are {self.bubbles.status}"

    def _watch(self) -> None:
        """Say why images are of no use, and give up on a service whose images do not come."""
        self.inputs.watch()
        self.gathering.watch()

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {"method": self.parameters.method, **self.inputs.counts()}
        values["identity"] = self.bubbles.status
        values["clocks"] = self.inputs.clocks.remark
        if self.core is not None and self.core.timing is not None:
            values |= self.core.timing.values() | {"fingers_closed_mm": round(1e3 * self.core.closing, 2)}
        values |= self.counters.values()
        if self._latencies:
            values |= diagnostics.percentiles_ms("arrival", self._arrivals, 2)
            values |= diagnostics.percentiles_ms("latency", self._latencies, 2)
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
    fill(message.centroid, patch.centroid)
    fill(message.centroid_in_hand, patch.centroid_C)
    return message


main = EstimatorNode.main
