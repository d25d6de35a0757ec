# SPDX-License-Identifier: Apache-2.0
"""CameraInfo from and to what cores know: size, K, D and the name of the distortion model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sensor_msgs.msg import CameraInfo

from seed_ros.conversions import stamp_from_seconds


class Intrinsics(NamedTuple):
    """Arguments of a camera model's constructor."""

    width: int
    height: int
    k: Sequence[float]
    d: Sequence[float]
    model: str


def intrinsics(message: CameraInfo, rectified: bool) -> Intrinsics:
    """Of the stream that goes with the message.

    A rectified stream has no distortion, whatever D says of the raw one, and P's left block for K (REP-104).
    """
    if not rectified:
        return Intrinsics(message.width, message.height, list(message.k), list(message.d), message.distortion_model)
    p = list(message.p)
    k = [*p[0:3], *p[4:7], *p[8:11]] if p[0] > 0.0 else list(message.k)
    return Intrinsics(message.width, message.height, k, [], "plumb_bob")


def camera_info(values: Intrinsics, t: float, frame_id: str) -> CameraInfo:
    """CameraInfo of a camera without rectification of its own: P is K, R the identity."""
    k = [float(v) for v in values.k]
    message = CameraInfo(width=values.width, height=values.height, distortion_model=values.model or "plumb_bob")
    message.header.stamp = stamp_from_seconds(t)
    message.header.frame_id = frame_id
    message.k = k
    message.d = [float(v) for v in values.d]
    message.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    message.p = [*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0]
    return message
