# SPDX-License-Identifier: Apache-2.0
"""The time series of one run, read from its bag; needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from seed_bringup.bags.files import read_messages
from seed_core.errors import SeedError
from seed_core.spatial import Array, make_pose


class SeriesError(SeedError):
    """A bag that does not hold what is needed."""


@dataclass(frozen=True, eq=False)
class Series:
    """Stamps t (N,) [s] and values (N, ...) of one topic, in the order of their stamps."""

    t: Array
    values: Array

    def between(self, start: float, end: float) -> Series:
        """The part with start <= t <= end."""
        keep = (self.t >= start) & (self.t <= end)
        return Series(self.t[keep], self.values[keep])

    def since(self, start: float) -> Series:
        """The same with stamps that count from `start` [s]."""
        return Series(self.t - start, self.values)

    def nearest(self, t: Array) -> Array:
        """The values (M, ...) whose stamps are nearest to t (M,)."""
        right = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        left = right - 1
        return np.asarray(self.values[np.where(t - self.t[left] < self.t[right] - t, left, right)])


def read_series(bag: Path, topics: dict[str, str]) -> dict[str, Series]:
    """Series by name of the topics given as name: topic. Poses become (4, 4), wrenches (6,) [torque, force].

    An estimate of a wrench becomes (42,): the wrench, then its covariance row by row, force first.

    Raises:
        SeedError: no readable bag, or a topic without messages.
    """
    rows: dict[str, list[tuple[float, Array]]] = {topic: [] for topic in topics.values()}
    for topic, kind, message in read_messages(bag, rows.__contains__):
        value = _value(message, kind)
        if value is not None:
            stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            rows[topic].append((stamp, value))
    out = {}
    for name, topic in topics.items():
        if not rows[topic]:
            raise SeriesError(f"{bag}: nothing was recorded on {topic}")
        stamps, values = zip(*sorted(rows[topic], key=lambda row: row[0]), strict=True)
        out[name] = Series(np.array(stamps), np.stack(values))
    return out


def _value(message: Any, kind: str) -> Array | None:
    """The message's content as an array; None for an estimate that is not valid."""
    match kind:
        case "geometry_msgs/msg/PoseStamped":
            return _pose(message.pose)
        case "geometry_msgs/msg/WrenchStamped":
            return _wrench(message.wrench)
        case "seed_msgs/msg/WrenchEstimate":
            return np.concatenate([_wrench(message.wrench), message.covariance])
        case "seed_msgs/msg/RelativePose":
            return _pose(message.pose.pose) if message.valid else None
        case "seed_msgs/msg/ControllerState":
            return np.concatenate([_wrench(message.desired), _wrench(message.estimated), message.lean])
    raise SeriesError(f"messages of type {kind} have no series")


def _pose(pose: Any) -> Array:
    q, p = pose.orientation, pose.position
    return make_pose(Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), [p.x, p.y, p.z])


def _wrench(w: Any) -> Array:
    return np.array([w.torque.x, w.torque.y, w.torque.z, w.force.x, w.force.y, w.force.z])
