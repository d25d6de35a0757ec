# SPDX-License-Identifier: Apache-2.0
"""The nodes of both membranes on their way from the plant's process to the cameras'.

One array: time [s] of the solve, 1 while a tool is in the grasp and 0 otherwise, then x, y, z in C [m] of the left
membrane's nodes and of the right one's. Both processes make the same mesh from the same scenario.
"""

from typing import NamedTuple

import numpy as np
from std_msgs.msg import Float64MultiArray

from seed_core.hand import FINGERS
from seed_core.spatial import Array
from seed_ros import MessageError

TOPIC = "ground_truth/membranes"  # of the node `sim`
_HEAD = 2


class Membranes(NamedTuple):
    """Time of the solve [s], whether a tool is in the grasp, and nodes (n, 3) in C by finger [m]."""

    stamp: float
    grasped: bool
    nodes: dict[str, Array]


def membranes_to_message(membranes: Membranes) -> Float64MultiArray:
    """The message."""
    flat = [membranes.nodes[f].ravel() for f in FINGERS]
    return Float64MultiArray(data=np.concatenate([[membranes.stamp, float(membranes.grasped)], *flat]).tolist())


def membranes_from_message(message: Float64MultiArray, count: int) -> Membranes:
    """What the message says; count: nodes of each mesh.

    Raises:
        MessageError: another number of nodes, or a value that is not finite.
    """
    data = np.asarray(message.data)
    if data.size != _HEAD + 6 * count:
        raise MessageError(
            f"{TOPIC} holds {data.size} numbers, {_HEAD + 6 * count} are expected: give sim and bubbles one scenario"
        )
    if not np.isfinite(data).all():
        raise MessageError(f"{TOPIC} has a value that is not finite")
    both = data[_HEAD:].reshape(2, count, 3)
    return Membranes(float(data[0]), data[1] > 0.5, dict(zip(FINGERS, both, strict=True)))
