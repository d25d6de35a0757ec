# SPDX-License-Identifier: Apache-2.0
"""Writes serialized messages to an MCAP bag: a folder as `ros2 bag` makes it, or one file when it ends in .mcap."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from seed_bringup.bags.types import BagError, InstalledTypes


class BagWriter:
    """A bag being written; complete only after close()."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.single = path.suffix == ".mcap"
        self._folder = path.with_name(f".{path.stem}-being-written") / path.stem if self.single else path
        if path.exists():
            raise BagError(f"{path} exists already; choose another name, bags are never overwritten")
        if self.single:
            shutil.rmtree(self._folder.parent, ignore_errors=True)
        self.types = InstalledTypes()
        self._writer = Writer(self._folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self.counts: dict[str, int] = {}

    def add_topic(self, topic: str, type_name: str, offered: Sequence[Qos] = ()) -> Connection:
        """Declare a topic; what it returns goes to write()."""
        self.types.load(type_name)
        self.counts[topic] = 0
        return self._writer.add_connection(
            topic, type_name, typestore=self.types.store, offered_qos_profiles=list(offered)
        )

    def write(self, connection: Connection, stamp: int, data: bytes) -> None:
        """Append one message in CDR, received at `stamp` [ns]."""
        self._writer.write(connection, stamp, data)
        self.counts[connection.topic] += 1

    def close(self) -> None:
        """Write the index; move a single file to its place."""
        self._writer.close()
        if self.single:
            (self._folder / f"{self._folder.name}.mcap").replace(self.path)
            shutil.rmtree(self._folder.parent)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
