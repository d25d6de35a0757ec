# SPDX-License-Identifier: Apache-2.0
"""Samples from a bag: the node publishes every line of its file on `identification/samples` (std_msgs/String)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seed_sysid.data.dataset import FORMAT, Dataset, DatasetError
from seed_sysid.data.sample_file import parse

TOPIC, TYPE = "identification/samples", "std_msgs/msg/String"


def read_bag(path: Path) -> Dataset:
    """Header and samples recorded in a bag (folder, .mcap or .db3).

    Raises:
        DatasetError: no bag, none with that topic, or one with several identifications.
    """
    from rosbags.rosbag2 import Reader, ReaderError

    try:
        with Reader(_bag(path)) as reader:
            lines = _lines(reader, path)
    except (ReaderError, OSError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read as a bag: {error}") from error
    different = list(dict.fromkeys(lines))  # a run that goes on publishes what it has once more
    headers = [line for line in different if f'"format": "{FORMAT}"' in line]
    if len(headers) > 1:
        raise DatasetError(f"{path} holds {len(headers)} identifications: record each in a bag of its own")
    return parse(headers + [line for line in different if line not in headers], str(path))


def _bag(path: Path) -> Path:
    """What the reader wants: the folder where there is one with metadata, else the single file."""
    return path.parent if not path.is_dir() and (path.parent / "metadata.yaml").is_file() else path


def _lines(reader: Any, path: Path) -> list[str]:
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_JAZZY)
    connections = [c for c in reader.connections if c.topic.endswith(TOPIC) and c.msgtype == TYPE]
    if not connections:
        topics = ", ".join(sorted({c.topic for c in reader.connections})[:8])
        raise DatasetError(
            f"{path} has no topic of {TYPE} ending in {TOPIC}; it has: {topics}: record that topic as well"
        )
    messages: list[Any] = [types.deserialize_cdr(raw, TYPE) for _, _, raw in reader.messages(connections)]
    return [str(m.data) for m in messages]
