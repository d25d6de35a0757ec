# SPDX-License-Identifier: Apache-2.0
"""A recorded press through the real estimator node, image by image: nothing is lost on a slow machine."""

from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from ament_index_python.packages import get_package_share_directory
from seed_msgs.msg import ContactPatches
from std_srvs.srv import Trigger

from seed_core.config import load_file
from seed_core.errors import FailedError
from seed_estimation import ContactPatch, EstimatorParameters
from seed_estimation.ros.node import EstimatorNode
from seed_ros.qos import COMMAND, SENSOR
from seed_ros.testing import Bench
from seed_testing.recordings.press import Findings, Press, findings
from seed_testing.recordings.press_bag import START, TOPICS, frames

STILL = 15  # frames of the press that make the reference
LEAD = 10.0  # [s] from the reference to the press
PATIENCE = 10.0  # [s] for the node's answer to one frame

Messages = dict[str, Any]  # by topic


def through_node(recording: Press) -> Findings:
    """Contact of every frame as the node tells it, with the settings for a D405.

    Raises:
        SeedError: the node does not answer.
    """
    file = Path(get_package_share_directory("seed_estimation"), "config", "d405.yaml")
    with closing(Bench()) as bench:
        player = _Player(bench, load_file(file, EstimatorParameters).__dict__)
        player.reference([messages for _, messages in islice(frames(recording), STILL + 1)])
        found = [player.patch(messages) for _, messages in frames(recording, start=START + LEAD)]
    return findings(found, recording.force())


class _Player:
    """Publishes frames and waits for the estimator node's answer to each."""

    def __init__(self, bench: Any, settings: dict[str, Any]) -> None:
        self._bench = bench
        self._node = bench.add(EstimatorNode, fingers="left", reference_frames=STILL, publish_tf=False, **settings)
        self._outputs = {
            topic: bench.client.create_publisher(kind, f"bubble_left/{topic}", SENSOR) for topic, kind in TOPICS.items()
        }
        self._answers: list[ContactPatches] = []
        bench.client.create_subscription(ContactPatches, "contact_patches", self._answers.append, COMMAND)
        bench.until(lambda: all(o.get_subscription_count() for o in self._outputs.values()), PATIENCE)

    def _publish(self, frame: Messages) -> None:
        for topic, message in frame.items():
            self._outputs[topic].publish(message)

    def reference(self, still: list[Messages]) -> None:
        """The frames as the reference without contact; the first comes before camera_info."""
        client = self._bench.client.create_client(Trigger, "estimator/capture_reference")
        self._bench.until(client.service_is_ready, PATIENCE)
        answer = client.call_async(Trigger.Request())
        self._bench.spin(0.3)
        for frame in still:
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
