# SPDX-License-Identifier: Apache-2.0
"""A recorded press as a bag through the real estimator node, image by image: nothing is lost on a slow machine."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from ament_index_python.packages import get_package_share_directory
from rosbags.highlevel import AnyReader
from seed_msgs.msg import ContactPatches
from std_srvs.srv import Trigger

from seed_bringup.bags.types import message_class
from seed_core.config import load_file
from seed_core.errors import FailedError
from seed_estimation import ContactPatch, EstimatorParameters
from seed_estimation.ros.node import EstimatorNode
from seed_ros.qos import COMMAND, SENSOR
from seed_ros.testing import Bench
from seed_testing.recordings import press
from seed_testing.recordings.press_bag import START, write

STILL = 15  # frames of the press that make the reference
LEAD = 10_000_000_000  # [ns] from the reference to the press
PATIENCE = 10.0  # [s] for the node's answer to one frame


def through_node(recording: press.Press) -> press.Findings:
    """Contact of every frame as the node tells it, with the settings for a D405.

    Raises:
        SeedError: the node does not answer.
    """
    file = Path(get_package_share_directory("seed_estimation")) / "config" / "d405.yaml"
    with tempfile.TemporaryDirectory() as name:
        return _play(recording, Path(name), load_file(file, EstimatorParameters).__dict__)


def _play(recording: press.Press, place: Path, settings: dict[str, Any]) -> press.Findings:
    write(recording, place / "still.mcap", start=START, frames=STILL + 1)  # the first comes before camera_info
    write(recording, place / "press.mcap", start=START + LEAD)
    bench = Bench()
    try:
        node = bench.add(EstimatorNode, fingers="left", reference_frames=STILL, publish_tf=False, **settings)
        player = _Player(bench, node)
        player.reference(place / "still.mcap")
        found = [player.patch(frame) for frame in frames(place / "press.mcap")]
    finally:
        bench.close()
    return press.findings(found, recording.force())


Messages = list[tuple[str, str, bytes]]  # topic, type, message in CDR


def frames(bag: Path) -> Iterator[Messages]:
    """Messages of a bag that belong to one time."""
    frame, at = [], None
    with AnyReader([bag]) as reader:
        for connection, stamp, data in reader.messages():
            if at is not None and stamp != at:
                yield frame
                frame = []
            at = stamp
            frame.append((connection.topic, connection.msgtype, bytes(data)))
    yield frame


class _Player:
    """Publishes a bag's frames and waits for the node's answer to each."""

    def __init__(self, bench: Any, node: Any) -> None:
        self._bench, self._node = bench, node
        self._outputs: dict[str, Any] = {}
        self._answers: list[Any] = []
        bench.client.create_subscription(ContactPatches, "contact_patches", self._answers.append, COMMAND)

    def _publish(self, frame: Messages) -> None:
        for topic, kind, _ in frame:
            if topic not in self._outputs:
                output = self._bench.client.create_publisher(message_class(kind), topic, SENSOR)
                self._outputs[topic] = output
                self._bench.until(lambda output=output: output.get_subscription_count() > 0, PATIENCE)
        for topic, _, data in frame:
            self._outputs[topic].publish(data)

    def reference(self, bag: Path) -> None:
        """The frames of a bag as the reference without contact."""
        client = self._bench.client.create_client(Trigger, "estimator/capture_reference")
        self._bench.until(client.service_is_ready, PATIENCE)
        answer = client.call_async(Trigger.Request())
        self._bench.spin(0.3)
        for frame in frames(bag):
            before = self._node.inputs.counts()["pairs"]
            self._publish(frame)
            self._bench.until(lambda before=before: self._node.inputs.counts()["pairs"] > before, PATIENCE)
        if not self._bench.until(answer.done, PATIENCE) or not answer.result().success:
            raise FailedError(f"no reference: {answer.result().message if answer.done() else 'the node is silent'}")

    def patch(self, frame: Messages) -> ContactPatch:
        """The contact that the node reports for a frame."""
        self._answers.clear()
        self._publish(frame)
        if not self._bench.until(lambda: self._answers, PATIENCE):
            raise FailedError("the estimator node does not answer an image")
        told = self._answers[-1].patches[0]
        at = np.array((told.centroid.x, told.centroid.y, told.centroid.z))
        return ContactPatch(told.finger, told.in_contact, at, mean_indentation=told.mean_indentation)
