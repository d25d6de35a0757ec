# SPDX-License-Identifier: Apache-2.0
"""The image streams of the fingers: subscriptions, pairing by stamp, calibration, conversion."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from sensor_msgs.msg import CameraInfo, Image

from seed_core.clocks import CLOCKS_DOC, read_clocks
from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.hand import FINGERS_OF
from seed_estimation.images import identity
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import TactileImages
from seed_ros import SENSOR, MessageError, SeedNode
from seed_ros.images import (
    IMAGES,
    INFO,
    Pairing,
    SerializedImage,
    depth_from_message,
    gray_from_message,
    intrinsics,
    read_image,
)

LATEST = 3  # images of each stream that are looked at for why none has a partner
NO_IMAGES = 3.0  # [s] without any, after which that is told


@dataclass(frozen=True)
class InputSettings:
    """How images are taken in."""

    fingers: str = field("both", choices=tuple(FINGERS_OF), doc="which bubbles have a camera")
    rectified: bool = field(False, doc="streams are rectified: ignore D, use P of camera_info")
    pair_tolerance: float = field(0.005, unit="s", low=0.0, high=0.1, doc="between depth and infrared of one finger")
    finger_tolerance: float = field(
        0.025, unit="s", low=0.0, high=0.1, doc="between the images of both fingers; max_skew bounds what is used of it"
    )
    clock_offset: float = field(
        0.0,
        unit="s",
        low=-1.0,
        high=1.0,
        doc="by which images' stamps are ahead of the robot's, beyond what clocks says",
    )
    clocks: str = field("", doc=CLOCKS_DOC)
    silence: float = field(0.5, unit="s", low=0.05, high=10.0, doc="after which a finger counts as silent")


class ImageInputs:
    """Calls `ready` with the images of one moment, or `problem` with the reason why there are none."""

    def __init__(
        self,
        node: SeedNode,
        settings: InputSettings,
        bubbles: identity.KnownBubbles,
        ready: Callable[[float, dict[str, TactileImages]], None],
        problem: Callable[[float, str], None],
        calibrated: Callable[[], None],
    ) -> None:
        """Subscribe, in the loop of the node.

        Args:
            bubbles: tells the fingers apart.
            ready: gets the stamp [s] and the images of one moment, by finger.
            problem: gets the stamp [s] and the reason.
            calibrated: called when every finger's camera is known, and when one is another.
        """
        self.settings, self._bubbles = settings, bubbles
        self.clocks = read_clocks(settings.clocks)
        self._ahead = settings.clock_offset + self.clocks.offset  # [s]
        self.fingers = FINGERS_OF[settings.fingers]
        self.cameras: dict[str, PinholeCamera] = {}
        self.frame_ids: dict[str, str] = {}
        self._camera_problems: dict[str, str] = {}  # by finger whose camera_info was refused
        self._now, self._counters = node.now, node.counters
        self._ready, self._problem, self._calibrated = ready, problem, calibrated
        self.arrived = 0.0  # [s] when the images that are being worked on were complete
        self._images = {f: Pairing[SerializedImage](tuple(IMAGES), settings.pair_tolerance) for f in self.fingers}
        self._both = Pairing[dict[str, SerializedImage]](self.fingers, settings.finger_tolerance)
        self._heard: dict[str, float] = {}
        self._latest: dict[tuple[str, str], deque[float]] = {}  # [s] stamps of the newest images of finger and kind
        self._unanswered = 0  # images since anything was said about one
        self._answered = time.monotonic()
        self._calibrations: dict[str, tuple[object, ...]] = {}  # camera_info comes with every image
        topics = [(f, *item) for f in self.fingers for item in (*IMAGES.items(), ("info", INFO))]
        # as they are called after remapping, which is where whoever looks for them finds them
        self._topics = {(f, kind): node.resolve_topic_name(f"bubble_{f}/{t}").lstrip("/") for f, kind, t in topics}
        for finger in self.fingers:
            for kind, topic in IMAGES.items():
                node.loop.poll(
                    Image, f"bubble_{finger}/{topic}", partial(self._on_image, finger, kind), SENSOR, raw=True
                )
            node.loop.poll(CameraInfo, f"bubble_{finger}/{INFO}", partial(self._on_info, finger), SENSOR)

    def counts(self) -> dict[str, float]:
        """Paired sets, images that found no partner or came out of order, and how far apart the last stamps were."""
        pairings: list[Pairing[Any]] = [self._both, *self._images.values()]
        return {
            "pairs": self._both.complete,
            "sets_missing": self._both.missing,
            "lost": self._both.missing,
            "images_unpaired": sum(p.unpaired for p in pairings),
            "images_out_of_order": sum(p.backwards for p in pairings),
            "stamps_apart_ms": 1e3 * self._both.skew,
        }

    def _on_info(self, finger: str, message: CameraInfo) -> None:
        numbers = bytes(message.k), bytes(message.p), bytes(message.d)
        calibration = (message.width, message.height, *numbers, message.distortion_model)
        if self._calibrations.get(finger) == calibration:
            return
        self._calibrations[finger] = calibration
        try:
            camera = PinholeCamera.from_info(*intrinsics(message, self.settings.rectified))
            _refuse(identity.other_lens(finger, camera.K, self._bubbles.known))
        except SeedError as error:
            self._camera_problems[finger] = f"{self._topics[finger, 'info']}: {error}"
            self._counters.add("camera_info_refused", self._camera_problems[finger])
            self.cameras.pop(finger, None)  # it is another camera than before, or set up otherwise
            return
        self._camera_problems.pop(finger, None)
        known = self.cameras.get(finger)
        if known is None or not known.matches(camera):
            self.cameras[finger] = camera
            if set(self.cameras) == set(self.fingers):
                self._calibrated()

    def watch(self) -> None:
        """Says why no images come, or why none of them has its partners; to be called now and then."""
        if not self._latest and time.monotonic() - self._answered > NO_IMAGES:
            self._answered = time.monotonic()
            finger = self.fingers[0]
            self._counters.add(
                "no_images",
                f"no images at all, such as on {self._topics[finger, 'depth']}: do the cameras run in this ROS domain, "
                "and are their topics called so (left_bubble:=, right_bubble:= of the launch files)?",
            )
        if self._unanswered and time.monotonic() - self._answered > self.settings.silence:
            self._unanswered = 0
            newest = max(stamps[-1] for stamps in self._latest.values())
            self._no_images("images_without_partner", newest, self._why_unpaired())

    def _why_unpaired(self) -> str:
        for finger in self.fingers:
            for kind in IMAGES:
                stamps = self._latest.get((finger, kind))
                if stamps is None:
                    return f"no images on {self._topics[finger, kind]}: is the camera running?"
                if len(stamps) == LATEST and stamps[0] == stamps[-1]:
                    return (
                        f"images on {self._topics[finger, kind]} are all stamped {stamps[0]:.3f} s: each must be "
                        "stamped by its exposure"
                    )
        most = self.settings.pair_tolerance
        for finger in self.fingers:
            apart = self._apart((finger, "depth"), (finger, "ir"), most)
            if apart > most:
                return f"depth and infrared images of bubble_{finger} are {apart:.3f} s apart (at most {most:g} s)"
        if len(self.fingers) > 1:
            most = self.settings.finger_tolerance
            apart = self._apart(("left", "depth"), ("right", "depth"), most)
            if apart > most:
                return f"images of bubble_left and bubble_right are {apart:.3f} s apart (at most {most:g} s)"
        return "images have no partners with the same stamps: are the cameras' clocks and rates the same?"

    def _apart(self, one: tuple[str, str], other: tuple[str, str], most: float) -> float:
        """[s] between the newest images of two streams; 0 where a partner has come to one of the newest."""
        a, b = self._latest[one], self._latest[other]
        return 0.0 if min(abs(s - t) for s in a for t in b) <= most else abs(a[-1] - b[-1])

    def _on_image(self, finger: str, kind: str, serialized: bytes, _: Any) -> None:
        try:
            message = read_image(serialized)
        except SeedError as error:
            self._counters.add("images_refused", f"{self._topics[finger, kind]}: {error}")
            return
        stamp = message.stamp - self._ahead
        self._latest.setdefault((finger, kind), deque(maxlen=LATEST)).append(stamp)
        self._unanswered += 1
        done = self._images[finger].add(kind, stamp, message)
        if done is None:
            return
        self._heard[finger] = done[0]
        silent = [f for f in self.fingers if done[0] - self._heard.get(f, done[0]) > self.settings.silence]
        if silent:
            self._counters.add("finger_silent", f"no images of bubble_{silent[0]} for {self.settings.silence:g} s")
            self._convert(done[0], {finger: done[1]})
            return
        together = self._both.add(finger, done[0], done[1])
        if together is not None:
            self._convert(together[0], together[1])

    def _convert(self, stamp: float, messages: dict[str, dict[str, SerializedImage]]) -> None:
        self.arrived, self._answered, self._unanswered = self._now(), time.monotonic(), 0
        try:
            images = {finger: self._pair(finger, pair) for finger, pair in messages.items()}
        except SeedError as error:
            self._no_images("images_refused", stamp, str(error))
            return
        missing = [f for f in self.fingers if f not in self.cameras]
        if missing:
            where = self._topics[missing[0], "info"]
            reason = (
                self._camera_problems.get(missing[0]) or f"no message on {where} yet: without it depth has no geometry"
            )
            self._no_images("images_without_camera_info", stamp, reason)
            return
        self._ready(stamp, images)

    def _no_images(self, cause: str, stamp: float, reason: str) -> None:
        self._counters.add(cause, reason)
        self._problem(stamp, reason)

    def _pair(self, finger: str, pair: dict[str, SerializedImage]) -> TactileImages:
        camera = self.cameras.get(finger)
        for kind, message in pair.items():
            if camera is not None and (message.width, message.height) != (camera.width, camera.height):
                raise MessageError(
                    f"{self._topics[finger, kind]}: image of {message.width} x {message.height} pixels; camera_info "
                    f"says {camera.width} x {camera.height}"
                )
        self.frame_ids[finger] = pair["depth"].frame_id
        _refuse(identity.misnamed(finger, self.frame_ids[finger], self._bubbles.names))
        depth = depth_from_message(pair["depth"], self._topics[finger, "depth"])
        ir, stamp = gray_from_message(pair["ir"], self._topics[finger, "ir"]), pair["depth"].stamp - self._ahead
        return TactileImages(depth=depth, ir=ir, stamp=stamp)


def _refuse(reason: str) -> None:
    if reason:
        raise MessageError(reason)
