# SPDX-License-Identifier: Apache-2.0
"""The time series of one run, read from its bag; needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader, AnyReaderError
from scipy.spatial.transform import Rotation

from seed_core.errors import SeedError
from seed_core.spatial import make_pose, rpy_from_rotation

Array = NDArray[np.float64]


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

    def at(self, t: Array) -> Array:
        """Values interpolated at t (M,): (M, ...)."""
        flat = self.values.reshape(len(self.t), -1)
        columns = [np.interp(t, self.t, flat[:, i]) for i in range(flat.shape[1])]
        return np.stack(columns, axis=1).reshape(len(t), *self.values.shape[1:])


def read_series(bag: Path, topics: dict[str, str]) -> dict[str, Series]:
    """Series by name of the topics given as name: topic. Poses become (4, 4), wrenches (6,) [torque, force].

    Raises:
        SeriesError: no readable bag, or a topic without messages.
    """
    by_topic = {topic: name for name, topic in topics.items()}
    rows: dict[str, list[tuple[float, Array]]] = {name: [] for name in topics}
    try:
        with AnyReader([bag]) as reader:
            for connection, _, data in reader.messages([c for c in reader.connections if c.topic in by_topic]):
                message: Any = reader.deserialize(data, connection.msgtype)
                value = _value(message, connection.msgtype)
                if value is not None:
                    stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
                    rows[by_topic[connection.topic]].append((stamp, value))
    except (OSError, AnyReaderError) as error:
        raise SeriesError(f"{bag}: not a readable bag: {error}") from error
    for name, found in rows.items():
        if not found:
            raise SeriesError(f"{bag}: nothing was recorded on {topics[name]}")
    return {name: _sorted(found) for name, found in rows.items()}


def _sorted(rows: list[tuple[float, Array]]) -> Series:
    t = np.array([stamp for stamp, _ in rows])
    order = np.argsort(t, kind="stable")
    return Series(t[order], np.stack([value for _, value in rows])[order])


def _value(message: Any, kind: str) -> Array | None:
    """The message's content as an array; None for an estimate that is not valid."""
    match kind:
        case "geometry_msgs/msg/PoseStamped":
            return _pose(message.pose)
        case "geometry_msgs/msg/WrenchStamped":
            return _wrench(message.wrench)
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


def axes_of(poses: Array) -> Array:
    """(N, 6) x, y, z [mm], roll, pitch, yaw [deg] of poses (N, 4, 4)."""
    rpy = np.array([rpy_from_rotation(X[:3, :3]) for X in poses])
    return np.hstack([1e3 * poses[:, :3, 3], np.rad2deg(rpy)])
