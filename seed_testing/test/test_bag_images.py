# SPDX-License-Identifier: Apache-2.0
"""Images of a bag are validated as the live estimator sees them."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from sensor_msgs.msg import Image

from seed_ros.images.arrays import DEPTH_ENCODINGS, GRAY_ENCODINGS, depth_from_message, gray_from_message
from seed_testing.validation.bag import BagDataError, image_of

pytestmark = pytest.mark.ros
GREY = [name for name, (_, channels) in GRAY_ENCODINGS.items() if channels == 1]


def picture(encoding: str, big_endian: bool) -> Image:
    """Three by two pixels, with padding behind each row and, where numbers allow it, values that are no distance."""
    kind = np.dtype({"32FC1": "f4", "mono8": "u1", "8UC1": "u1"}.get(encoding, "u2"))
    values = [[0.08, 0.0, -1.0], [np.inf, np.nan, 2.5]] if kind.kind == "f" else [[80, 0, 7], [255, 1, 90]]
    pixels = np.array(values, kind.newbyteorder(">" if big_endian else "<"))
    message = Image(height=2, width=3, encoding=encoding, step=3 * kind.itemsize + 4, is_bigendian=int(big_endian))
    message.data = b"".join(row.tobytes() + bytes(4) for row in pixels)
    return message


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("encoding", DEPTH_ENCODINGS)
def test_depth_of_a_bag_is_that_of_the_live_estimator(encoding: str, big_endian: bool) -> None:
    message = picture(encoding, big_endian)
    np.testing.assert_array_equal(image_of(message, "/bubble_left/depth/image_rect_raw"), depth_from_message(message))


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("encoding", GREY)
def test_brightness_of_a_bag_is_that_of_the_live_estimator(encoding: str, big_endian: bool) -> None:
    message = picture(encoding, big_endian)
    np.testing.assert_array_equal(image_of(message, "/bubble_left/ir/image_rect_raw"), gray_from_message(message))


def test_a_picture_that_is_no_depth_is_refused_by_name() -> None:
    with pytest.raises(BagDataError, match="encoding 'mono8' is not read; known: 32FC1, 16UC1, mono16"):
        image_of(picture("mono8", False), "/bubble_left/depth/image_rect_raw")
