# SPDX-License-Identifier: Apache-2.0
"""Bag files: described, and written as MCAP (a folder as `ros2 bag` makes it, or one file that ends in .mcap).

Needs no ROS but the definitions of the message types that are written.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, ReaderError, StoragePlugin, Writer

from seed_bringup.bags import BagError
from seed_bringup.bags.types import InstalledTypes


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
        size = sum(f.stat().st_size for f in (path.glob("*") if path.is_dir() else [path]))
        lines = [
            f"bag        {path}",
            f"size       {size / 1e6:.1f} MB",
            f"start      {started}",
            f"duration   {reader.duration * 1e-9:.3f} s",
            f"messages   {reader.message_count}",
        ]
        lines += [f"  {t.msgcount:>8}  {topic}  {t.msgtype}" for topic, t in sorted(reader.topics.items())]
        return "\n".join(lines)


class BagWriter:
    """A bag being written; complete only after close()."""

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise BagError(f"{path} exists already; choose another name, bags are never overwritten")
        self.path = path
        self._single = path.suffix == ".mcap"
        folder = path
        if self._single:
            folder = path.with_name(f".{path.stem}-being-written") / path.stem
            shutil.rmtree(folder.parent, ignore_errors=True)
        self.types = InstalledTypes()
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self.counts: dict[str, int] = {}

    def add_topic(self, topic: str, type_name: str, offered: Sequence[Qos] = ()) -> Connection:
        """Declare a topic; what it returns goes to write()."""
        self.types.load(type_name)
        self.counts[topic] = 0
        return self._writer.add_connection(topic, type_name, typestore=self.types.store, offered_qos_profiles=offered)

    def write(self, connection: Connection, stamp: int, data: bytes) -> None:
        """Append one message in CDR, received at `stamp` [ns]."""
        self._writer.write(connection, stamp, data)
        self.counts[connection.topic] += 1

    def close(self) -> None:
        """Write the index; move a single file to its place."""
        self._writer.close()
        if self._single:
            folder = self._writer.path
            (folder / f"{folder.name}.mcap").replace(self.path)
            shutil.rmtree(folder.parent)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
