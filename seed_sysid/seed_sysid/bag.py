# SPDX-License-Identifier: Apache-2.0
"""Samples from a bag: the node publishes every line of its file on `identification/samples` (std_msgs/String)."""

from __future__ import annotations

from pathlib import Path

from seed_sysid.dataset import Dataset, DatasetError, parse

TOPIC = "identification/samples"


def read_bag(path: Path) -> Dataset:
    """Header and samples recorded in a bag (folder, .mcap or .db3).

    Raises:
        DatasetError: no bag, or none with that topic.
    """
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    folder = path if path.is_dir() else path.parent
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            connections = [c for c in reader.connections if c.topic.endswith(TOPIC)]
            if not connections:
                topics = ", ".join(sorted({c.topic for c in reader.connections})[:8])
                raise DatasetError(
                    f"{path} has no topic ending in {TOPIC}; it has: {topics}: record that topic as well"
                )
            lines = [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages(connections)]
    except (AnyReaderError, OSError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read as a bag: {error}") from error
    return parse(list(dict.fromkeys(lines)), str(path))
