# SPDX-License-Identifier: Apache-2.0
"""Images read from and written to their serialized form are those that the middleware's own functions give."""

import contextlib
import struct

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image

from seed_core.errors import SeedError
from seed_ros.images.arrays import depth_from_message, image_message
from seed_ros.images.serialized import ImageWriter, read_image

pytestmark = pytest.mark.ros


class Wire:
    """In place of a publisher: keeps what was published."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def publish(self, message: bytes) -> None:
        self.sent.append(message)


@given(frame=st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=9), width=st.integers(1, 9))
@settings(deadline=None, derandomize=True, database=None)
def test_every_field_is_read_as_the_middleware_reads_it(frame: str, width: int) -> None:
    message = image_message(np.arange(3 * width, dtype=np.uint16).reshape(3, width), "mono16", 12.25, frame)
    message.is_bigendian = 1
    read = read_image(serialize_message(message))
    assert (read.stamp, read.frame_id, read.encoding, read.is_bigendian) == (12.25, frame, "mono16", 1)
    assert (read.height, read.width, read.step) == (3, width, 2 * width)
    assert bytes(read.data) == bytes(message.data)


def test_the_other_order_of_bytes_is_read_too() -> None:
    head = struct.pack(">BBHiII3sxII", 0, 0, 0, 7, 500_000_000, 4, b"cam", 1, 2)
    read = read_image(head + struct.pack(">I5sB2xII4s", 6, b"mono8", 0, 2, 2, b"\x05\x06"))
    assert (read.stamp, read.frame_id, read.height, read.width) == (7.5, "cam", 1, 2)


def test_a_writers_images_are_those_of_the_middleware_at_any_size() -> None:
    wire = Wire()
    writer = ImageWriter(wire, "32FC1", "left_optical")
    for t, shape in ((1.5, (3, 5)), (2.25, (3, 5)), (3.0, (4, 2))):
        pixels = np.full(shape, t, np.float32)
        writer.publish(pixels, t)
        expected = image_message(pixels, "32FC1", t, "left_optical")
        assert len(wire.sent[-1]) == len(serialize_message(expected))
        assert deserialize_message(wire.sent[-1], Image) == expected


def test_a_view_of_the_pixels_gives_the_same_depth_as_the_message() -> None:
    message = image_message(np.array([[0.1, np.nan, 0.0, np.inf, -1.0]], np.float32), "32FC1", 0.0, "camera")
    of_view, of_message = depth_from_message(read_image(serialize_message(message))), depth_from_message(message)
    np.testing.assert_array_equal(of_view, of_message)
    np.testing.assert_array_equal(of_view, np.array([[0.1, *[np.nan] * 4]], np.float32))


@given(st.binary(max_size=80), st.integers(0, 200))
@settings(deadline=None, derandomize=True, database=None)
def test_bytes_that_are_no_image_are_refused(noise: bytes, kept: int) -> None:
    whole = serialize_message(image_message(np.zeros((9, 9), np.uint8), "mono8", 0.0, "camera"))
    with contextlib.suppress(SeedError):  # noise may be an image, but not one larger than itself
        assert len(read_image(noise).data) <= len(noise)
    for cut in (whole[: min(kept, len(whole) - 1)], whole[:-1]):
        with pytest.raises(SeedError):
            read_image(cut)
