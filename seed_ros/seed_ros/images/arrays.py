# SPDX-License-Identifier: Apache-2.0
"""Image and CameraInfo messages to arrays and back, for the encodings that depth and infrared cameras use."""

from array import array
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from seed_ros.conversions import MessageError, stamped
from seed_ros.images.serialized import SerializedImage

DEPTH_ENCODINGS = {"32FC1": (np.float32, 1), "16UC1": (np.uint16, 1), "mono16": (np.uint16, 1)}
GRAY_ENCODINGS = {
    "mono16": (np.uint16, 1),
    "16UC1": (np.uint16, 1),
    "mono8": (np.uint8, 1),
    "8UC1": (np.uint8, 1),
    "32FC1": (np.float32, 1),
    "rgb8": (np.uint8, 3),
    "bgr8": (np.uint8, 3),
    "rgba8": (np.uint8, 4),
    "bgra8": (np.uint8, 4),
}
_LUMA_RGB = np.array((0.299, 0.587, 0.114), dtype=np.float32)  # ITU-R BT.601
MAX_PIXELS = 5_000_000  # more than any tactile camera
AnyImage: TypeAlias = Image | SerializedImage


def _array(message: AnyImage, encodings: Mapping[str, tuple[Any, int]], name: str) -> NDArray[np.generic]:
    if message.encoding not in encodings:
        hint = ""
        if encodings is DEPTH_ENCODINGS and GRAY_ENCODINGS.get(message.encoding, (None, 1))[1] > 1:
            hint = ": this is a picture of depth, made by a colorizer; switch the colorizer of the camera driver off"
        raise MessageError(f"{name}: encoding '{message.encoding}' is none of {', '.join(encodings)}{hint}")
    kind, channels = encodings[message.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    h, w, row = message.height, message.width, message.width * channels * dtype.itemsize
    if not 0 < h * w <= MAX_PIXELS:
        raise MessageError(f"{name}: {w} x {h} pixels; between 1 and {MAX_PIXELS} are possible")
    if message.step < row or len(message.data) != message.step * h:
        raise MessageError(
            f"{name}: {len(message.data)} bytes with step {message.step} contradict {w} x {h} {message.encoding} "
            f"(step at least {row}, {message.step} x {h} bytes)"
        )
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(h, message.step)[:, :row]
    out: NDArray[np.generic] = np.ascontiguousarray(rows).view(dtype)
    return out.reshape(h, w, channels) if channels > 1 else out.reshape(h, w)


def depth_from_message(message: AnyImage, name: str = "depth") -> NDArray[np.float32]:
    """Depth (H, W) [m], NaN where there is none, from 32FC1 [m] or 16UC1 [mm] (REP-118).

    Raises:
        MessageError: another encoding, or sizes that contradict each other.
    """
    raw = _array(message, DEPTH_ENCODINGS, name)
    depth = raw.astype(np.float32)
    if message.encoding != "32FC1":
        depth *= np.float32(1e-3)
    np.copyto(depth, np.float32(np.nan), where=~((depth > 0) & (depth < np.inf)))
    return depth


def gray_from_message(message: AnyImage, name: str = "ir") -> NDArray[np.float32]:
    """Brightness (H, W) [counts] from mono16, mono8, 32FC1 or a colour image (its luma, whatever its alpha).

    Pixels without a number are black.

    Raises:
        MessageError: another encoding, or sizes that contradict each other.
    """
    pixels = _array(message, GRAY_ENCODINGS, name)
    raw = pixels.astype(np.float32)
    if pixels.dtype.kind == "f":
        np.nan_to_num(raw, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    if raw.ndim == 3:
        raw = raw[..., :3] @ (_LUMA_RGB if message.encoding.startswith("rgb") else _LUMA_RGB[::-1])
    return raw


def full_pixel(encoding: str) -> float:
    """Of a full pixel [counts]: 255 of an encoding with 8 bits, 65535 of any other."""
    return 255.0 if GRAY_ENCODINGS.get(encoding, (None, 1))[0] is np.uint8 else 65535.0


def pixels_from_message(message: AnyImage, name: str = "ir") -> NDArray[np.generic]:
    """Pixels as they are, (H, W) or with 3 or 4 colours (H, W, C), of an image that gray_from_message takes.

    Raises:
        MessageError: another encoding, or sizes that contradict each other.
    """
    return _array(message, GRAY_ENCODINGS, name)


def image_message(data: NDArray[np.generic], encoding: str, t: float, frame_id: str) -> Image:
    """Image of an array (H, W) or (H, W, C) whose dtype fits the encoding, taken at t [s]."""
    contiguous = np.ascontiguousarray(data)
    message = stamped(Image, t, frame_id)
    message.height, message.width = int(data.shape[0]), int(data.shape[1])
    message.encoding = encoding
    message.is_bigendian = 0
    message.step = contiguous.nbytes // int(data.shape[0])
    message.data = array("B", contiguous.tobytes())
    return message
