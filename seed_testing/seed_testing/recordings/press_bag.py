# SPDX-License-Identifier: Apache-2.0
"""A recorded press as messages that the estimator node can be fed with, and as a bag of them.

    python -m seed_testing.recordings.press_bag PRESS.npz OUT.mcap [--finger left]

The recording itself stays where it is: only the bag, which nobody should commit, is written.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image

from seed_bringup.bags.files import BagWriter
from seed_core.hand import FINGERS
from seed_core.program.command_line import Parser, command
from seed_ros.images import Intrinsics, camera_info, image_message
from seed_testing.recordings.press import Press, load

START = 1.0  # [s] time of the first frame where the recording starts at zero
TOPICS = {"depth/camera_info": CameraInfo, "depth/image_rect_raw": Image, "ir/image_rect_raw": Image}


def frames(press: Press, finger: str = "left", start: float = START) -> Iterator[tuple[float, dict[str, Any]]]:
    """Time [s] and messages by topic of each frame: camera_info, depth (32FC1, metres), grey (mono8, on depth pixels).

    Args:
        start: time of the first frame [s].
    """
    camera, frame_id = press.camera, f"bubble_{finger}_optical_frame"
    intrinsics = Intrinsics(camera.width, camera.height, list(camera.K.ravel()), list(camera.D), camera.model)
    for images in press.images:
        t = start + images.stamp - press.images[0].stamp
        grey = np.rint(images.ir).astype(np.uint8)
        yield (
            t,
            {
                "depth/camera_info": camera_info(intrinsics, t, frame_id),
                "depth/image_rect_raw": image_message(images.depth.astype("<f4"), "32FC1", t, frame_id),
                "ir/image_rect_raw": image_message(grey, "mono8", t, frame_id),
            },
        )


def write(press: Press, path: Path, finger: str = "left") -> None:
    """One bag with the frames of one finger."""
    with BagWriter(path) as bag:
        topics = {
            topic: bag.add_topic(f"/bubble_{finger}/{topic}", f"sensor_msgs/msg/{kind.__name__}")
            for topic, kind in TOPICS.items()
        }
        for t, messages in frames(press, finger):
            for topic, message in messages.items():
                bag.write(topics[topic], round(t * 1e9), serialize_message(message))


@command("seed_testing.recordings.press_bag")
def main(argv: list[str]) -> int:
    """Write the bag."""
    parser = Parser(description="Turn a recorded press into a bag.")
    parser.add_argument("press", type=Path)
    parser.add_argument("bag", type=Path, help="must not exist; .mcap for a single file")
    parser.add_argument("--finger", choices=FINGERS, default="left")
    options = parser.parse_args(argv)
    write(load(options.press), options.bag, options.finger)
    print(f"written to {options.bag}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
