# SPDX-License-Identifier: Apache-2.0
"""What the cameras of both bubbles send: gathered from a running graph or from a bag."""

import time
from collections import deque
from collections.abc import Mapping
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image

from seed_bringup.bags.files import messages_of, open_bag
from seed_core.errors import SeedError
from seed_estimation import PinholeCamera
from seed_ros import FixedRateLoop
from seed_ros.images import IMAGES, INFO, SerializedImage, depth_from_message, gray_from_message, intrinsics, read_image

PATIENT = QoSProfile(depth=30, reliability=ReliabilityPolicy.BEST_EFFORT)  # a pause of this program loses nothing
KEPT = 20  # newest images of a stream whose pixels are kept
READ = {"depth": depth_from_message, "ir": gray_from_message}


class Seen(NamedTuple):
    """One image: stamp and arrival [s], how it is written, and the frame that it is of."""

    stamp: float
    arrival: float
    encoding: str
    frame_id: str
    height: int
    width: int


class Stream:
    """One stream of images.

    Attributes:
        seen: every image.
    """

    def __init__(self, kind: str, topic: str) -> None:
        self.kind, self.topic = kind, topic
        self.seen: list[Seen] = []
        self._newest: deque[SerializedImage] = deque(maxlen=KEPT)
        self._problem = ""

    def take(self, serialized: bytes, arrival: float) -> None:
        """Keep one image. Its pixels are read later: who listens has no time."""
        try:
            m = read_image(serialized)
        except SeedError as error:
            self._problem = str(error)
            return
        self.seen.append(Seen(m.stamp, arrival, m.encoding, m.frame_id, m.height, m.width))
        self._newest.append(m)

    def clear(self) -> None:
        """Forget all images."""
        self.seen.clear()
        self._newest.clear()

    @cached_property
    def pixels(self) -> list[NDArray[np.float32]]:
        """Arrays (H, W) of the newest: depth [m] or brightness [counts]."""
        out = []
        for message in self._newest:
            try:
                out.append(READ[self.kind](message, self.topic))
            except SeedError as error:
                self._problem = str(error)
        return out

    @property
    def problem(self) -> str:
        """Why an image could not be read, or ''."""
        return self._problem if self.pixels is not None else ""


class Observation:
    """All streams, by (finger, 'depth' or 'ir'); cameras and what is wrong with them, by finger."""

    def __init__(self, prefixes: Mapping[str, str], brightness: str = "ir", rectified: bool = False) -> None:
        """prefixes: of the topics, by finger."""
        self.fingers, self._rectified = tuple(prefixes), rectified
        below = {**IMAGES, "ir": f"{brightness}/image_rect_raw"}
        self.streams = {(f, k): Stream(k, f"{p}/{below[k]}") for f, p in prefixes.items() for k in IMAGES}
        self.infos = {f: f"{p}/{INFO}" for f, p in prefixes.items()}
        self.cameras: dict[str, PinholeCamera] = {}
        self.camera_problems = {f: f"no message on {topic}" for f, topic in self.infos.items()}

    def take_info(self, finger: str, message: CameraInfo) -> None:
        """Keep a calibration."""
        try:
            self.cameras[finger] = PinholeCamera.from_info(*intrinsics(message, self._rectified))
            self.camera_problems[finger] = ""
        except SeedError as error:
            self.camera_problems[finger] = str(error)

    def listen(self, seconds: float, sim_time: bool = False, first: float = 10.0) -> None:
        """Gather from the running graph for so long, from the first image on, which has `first` [s] to come."""
        context = Context()
        rclpy.init(args=[], context=context)
        clock = [Parameter("use_sim_time", value=True)] if sim_time else []
        node = Node("camera_contract", context=context, parameter_overrides=clock, start_parameter_services=False)
        try:
            loop = FixedRateLoop(node, 50.0, lambda: None, steady=True, eager=True)
            for stream in self.streams.values():
                loop.poll(Image, stream.topic, partial(_arrive, node, stream), PATIENT, raw=True)
            for finger, topic in self.infos.items():
                loop.poll(CameraInfo, topic, partial(self.take_info, finger), PATIENT)
            patience = time.monotonic() + first
            loop.run(lambda: self._begun() or time.monotonic() > patience)
            for stream in self.streams.values():
                stream.clear()
            end = time.monotonic() + seconds
            loop.run(lambda: time.monotonic() > end)
        finally:
            node.destroy_node()
            rclpy.try_shutdown(context=context)

    def _begun(self) -> bool:
        return all(stream.seen for stream in self.streams.values())

    def read(self, bag: Path) -> None:
        """Gather from a bag, whose times of recording stand for arrivals. Raises BagError."""
        streams = {f"/{s.topic.lstrip('/')}": s for s in self.streams.values()}
        infos = {f"/{topic.lstrip('/')}": finger for finger, topic in self.infos.items()}
        with open_bag(bag) as reader:
            wanted = [c for c in reader.connections if c.topic in streams or c.topic in infos]
            for connection, at, data in messages_of(reader, wanted) if wanted else ():
                if connection.topic in streams:
                    streams[connection.topic].take(bytes(data), 1e-9 * at)
                else:
                    self.take_info(infos[connection.topic], deserialize_message(bytes(data), CameraInfo))


def _arrive(node: Node, stream: Stream, serialized: bytes, _: Any) -> None:
    stream.take(serialized, node.get_clock().now().nanoseconds * 1e-9)
