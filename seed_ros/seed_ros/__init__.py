# SPDX-License-Identifier: Apache-2.0
"""Base of the suite's nodes, and what they share at the ROS edge. Images are in `seed_ros.images`."""

from seed_ros import conversions, diagnostics
from seed_ros.conversions import MessageError
from seed_ros.diagnostics import Counters, Diagnostics
from seed_ros.frames import FrameNames
from seed_ros.loop import FixedRateLoop
from seed_ros.node import SeedNode, TransformBroadcaster, client_node, run
from seed_ros.qos import CLOCK, COMMAND, LATCHED, QUEUE, SENSOR, TF

__all__ = [
    "CLOCK",
    "COMMAND",
    "LATCHED",
    "QUEUE",
    "SENSOR",
    "TF",
    "Counters",
    "Diagnostics",
    "FixedRateLoop",
    "FrameNames",
    "MessageError",
    "SeedNode",
    "TransformBroadcaster",
    "client_node",
    "conversions",
    "diagnostics",
    "run",
]
