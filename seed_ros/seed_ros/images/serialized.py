# SPDX-License-Identifier: Apache-2.0
"""Images in the form in which they travel: pixels are read where they lie, and written in one go.

rclpy would copy an image's pixels into one more form on either side and make a Python object of every field. That form
is the Common Data Representation (CDR) of the OMG, version 1: four bytes that tell the order of bytes, then the
fields in sequence, each aligned to its own size; strings and sequences begin with their length.
"""

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image

from seed_ros.conversions import MessageError, stamp_from_seconds

_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # behind the order of bytes


class SerializedImage(NamedTuple):
    """The fields of a sensor_msgs/Image; `data` is a view of the message."""

    stamp: float
    frame_id: str
    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: memoryview


def read_image(message: bytes) -> SerializedImage:
    """The image of a serialized sensor_msgs/Image. Raises MessageError when it is none."""
    try:
        order = "<" if message[1] & 1 else ">"
        sec, nanosec = struct.unpack_from(f"{order}iI", message, _STAMP_AT)
        frame_id, at = _string(message, 12, order)
        height, width = struct.unpack_from(f"{order}II", message, _aligned(at))
        encoding, at = _string(message, _aligned(at) + 8, order)
        step, size = struct.unpack_from(f"{order}II", message, _aligned(at + 1))
        data = memoryview(message)[_aligned(at + 1) + 8 :][:size]
        if len(data) < size:
            raise MessageError(f"a serialized image ends after {len(data)} of {size} bytes of pixels")
        return SerializedImage(sec + 1e-9 * nanosec, frame_id, height, width, encoding, message[at], step, data)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise MessageError(f"{len(message)} bytes are no serialized sensor_msgs/Image: {error}") from error


def _aligned(at: int) -> int:
    """The next place for a field of four bytes."""
    return (at + 3) & ~3


def _string(message: bytes, at: int, order: str) -> tuple[str, int]:
    """The string whose length is at `at`, and where it ends; a zero byte closes it."""
    (length,) = struct.unpack_from(f"{order}I", message, at)
    end = at + 4 + length
    return message[at + 4 : end - 1].decode(), end


class ImageWriter:
    """Publishes the images of one stream, which differ in stamp and pixels alone."""

    def __init__(self, publisher: Any, encoding: str, frame_id: str) -> None:
        self._publisher = publisher
        self._template = Image(encoding=encoding)
        self._template.header.frame_id = frame_id
        self._ends: tuple[bytes, bytes] = b"", b""  # what comes before and after the stamp

    def publish(self, pixels: NDArray[np.generic], t: float) -> None:
        """Publish pixels (H, W) of the dtype that fits the encoding, taken at t [s]."""
        if pixels.shape != (self._template.height, self._template.width):
            self._resize(pixels)
        stamp = stamp_from_seconds(t)
        before, after = self._ends
        self._publisher.publish(b"".join((before, _STAMP.pack(stamp.sec, stamp.nanosec), after, pixels.tobytes())))

    def _resize(self, pixels: NDArray[np.generic]) -> None:
        self._template.height, self._template.width = pixels.shape
        self._template.step = pixels.nbytes // pixels.shape[0]
        whole = serialize_message(self._template)  # ends with the length of data, which is none
        size = struct.pack("<I", pixels.nbytes)
        self._ends = whole[:_STAMP_AT], whole[_STAMP_AT + _STAMP.size : -4] + size
