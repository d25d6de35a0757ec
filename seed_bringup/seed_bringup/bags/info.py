# SPDX-License-Identifier: Apache-2.0
"""What a bag holds; needs no ROS."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from rosbags.rosbag2 import Reader, ReaderError

from seed_bringup.bags.types import BagError


def open_bag(path: Path) -> Reader:
    """A reader of a bag folder or file; the caller opens and closes it."""
    try:
        return Reader(path)
    except (OSError, ReaderError) as error:
        raise BagError(f"{path}: not a readable bag: {error}") from error


def describe_bag(path: Path) -> str:
    """Duration, size, and each topic with type and number of messages."""
    with open_bag(path) as reader:
        started = datetime.fromtimestamp(reader.start_time * 1e-9, tz=UTC).isoformat(timespec="milliseconds")
        lines = [
            f"bag        {path}",
            f"size       {_size(path) / 1e6:.1f} MB",
            f"start      {started}",
            f"duration   {reader.duration * 1e-9:.3f} s",
            f"messages   {reader.message_count}",
        ]
        counts = {topic: info.msgcount for topic, info in sorted(reader.topics.items())}
        lines += [f"  {n:>8}  {topic}  {reader.topics[topic].msgtype}" for topic, n in counts.items()]
        return "\n".join(lines)


def _size(path: Path) -> int:
    return sum(f.stat().st_size for f in path.glob("*")) if path.is_dir() else path.stat().st_size
