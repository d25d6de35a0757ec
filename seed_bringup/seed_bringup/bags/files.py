# SPDX-License-Identifier: Apache-2.0
"""Bag files: described, read, and written as MCAP (a folder as `ros2 bag` makes it, or one file that ends in .mcap).

Needs no ROS but the definitions of the message types that are written.
"""

import os
import shutil
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer, WriterError
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from seed_bringup.bags import BagError
from seed_bringup.bags.types import InstalledTypes

_MAGIC = b"\x89MCAP0\r\n"  # at both ends of a file, https://mcap.dev/spec


@contextmanager
def open_bag(path: Path) -> Iterator[Reader]:
    """A reader of a bag folder or file, until the block ends. Raises BagError: no readable bag."""
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # rosbags raises whatever its decoders trip over in a damaged file
        raise BagError(_cut_short(path) or _unreadable(path, error)) from error
    try:
        yield reader
    finally:
        reader.close()


def _unreadable(path: Path, error: Exception) -> str:
    """What rosbags found wrong with a bag, in words."""
    none = path.is_dir() and not (path / "metadata.yaml").exists()
    return f"{path}: not a readable bag: {'this folder has no metadata.yaml' if none else error}"


def _cut_short(path: Path) -> str:
    """What a bag is whose recorder was killed, or had no room left; '' for any other."""
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    for file in files if not (path / "metadata.yaml").exists() else ():
        with suppress(OSError), file.open("rb") as bag:
            begun = bag.read(len(_MAGIC)) == _MAGIC
            bag.seek(-min(len(_MAGIC), file.stat().st_size), os.SEEK_END)
            if begun and (path.is_dir() or bag.read() != _MAGIC):
                return (
                    f"{path}: its recording was cut short: `mcap recover {file} -o whole.mcap` writes what can be read "
                    "(the command line tool of mcap.dev)"
                )
    return ""


def _exists(path: Path) -> str:
    return f"{path} exists already; choose another name, bags are never overwritten"


def _being_written(path: Path, folder: Path) -> str:
    """Why `path` cannot be written while there is a folder with its data: of a recorder that runs, or was killed."""
    if folder == path:
        return _exists(path)
    file = folder / f"{folder.name}.mcap"
    recover = f"`mcap recover {file} -o whole.mcap` writes what can be read (the command line tool of mcap.dev); then "
    return (
        f"{path} is being written by another recorder, or its recording was cut short and {folder.parent} is left of "
        f"it: choose another name; or, if no recorder runs, {recover if file.exists() else ''}remove that folder"
    )


def messages_of(reader: Reader, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
    """Connection, stamp [ns] and bytes of each message. Raises BagError where the bag is damaged."""
    if not connections:  # of which rosbags would give all
        return
    stream = reader.messages(connections=connections)
    while True:
        try:
            found = next(stream, None)
        except Exception as error:  # as in open_bag
            raise BagError(f"{reader.path}: damaged: {error}") from error
        if found is None:
            return
        yield found


def check_versions(path: Path, connections: Collection[Connection], types: InstalledTypes) -> None:
    """Raises BagError: topics were recorded with other versions of their types than `types` has here."""
    for c in connections:
        if (digest := _digest(c)) and digest != types.hash(c.msgtype):
            raise BagError(
                f"{path}: {c.topic} was recorded with another version of {c.msgtype} than is installed here: "
                "read the bag with that version of the suite"
            )


def _digest(connection: Connection) -> str:
    """The hash of a topic's type as it was recorded; '' where the bag does not tell it."""
    if connection.digest or not connection.msgdef.data:
        return connection.digest
    recorded = Typestore()  # a single file holds definitions alone
    with suppress(Exception):  # as in open_bag
        recorded.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        return recorded.hash_rihs01(connection.msgtype)
    return ""


def read_messages(path: Path, wanted: Callable[[str], bool]) -> Iterator[tuple[str, str, Any]]:
    """Topic, type and content of the messages on the wanted topics, in the order of the bag.

    Raises:
        BagError: no readable bag.
    """
    stream = _decoded(path, wanted)
    while True:
        try:
            found = next(stream, None)
        except Exception as error:  # as in open_bag
            raise BagError(_unreadable(path, error)) from error
        if found is None:
            return
        yield found


def _decoded(path: Path, wanted: Callable[[str], bool]) -> Iterator[tuple[str, str, Any]]:
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if wanted(c.topic)]
        for connection, _, data in reader.messages(connections) if connections else ():
            yield connection.topic, connection.msgtype, reader.deserialize(data, connection.msgtype)


def describe_bag(path: Path) -> str:
    """Duration, size, and each topic with type and number of messages."""
    with open_bag(path) as reader:
        started = "never: it holds no message"
        if reader.message_count:  # without one rosbags has the last moment that there is
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


class BagWriter(Writer):
    """A bag being written, `with BagWriter(path) as bag`; complete only after the block, however that ends."""

    def __init__(self, path: Path) -> None:
        """Raises BagError: there is such a bag, or another of this name is being written or was cut short."""
        if path.exists():
            raise BagError(_exists(path))
        self.target = path
        folder = path
        if path.suffix == ".mcap":
            folder = path.with_name(f".{path.stem}-being-written") / path.stem
            if folder.parent.exists():
                raise BagError(_being_written(path, folder))
        super().__init__(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self.types = InstalledTypes()

    def add_topic(self, topic: str, type_name: str, offered: Sequence[Qos] = ()) -> Connection:
        """Declare a topic; what it returns goes to write(), with a stamp [ns] and a message in CDR."""
        self.types.load(type_name)
        return self.add_connection(topic, type_name, typestore=self.types, offered_qos_profiles=offered)

    def open(self) -> None:
        """Make the folder. Raises BagError: another writer was faster."""
        try:
            super().open()
        except WriterError as error:
            raise BagError(_being_written(self.target, self.path)) from error

    def close(self) -> None:
        """Write the index; move a single file to its place."""
        super().close()
        if self.path != self.target:
            (self.path / f"{self.path.name}.mcap").replace(self.target)
            shutil.rmtree(self.path.parent)

    def discard(self) -> None:
        """Remove the closed bag."""
        if self.target.is_dir():
            shutil.rmtree(self.target)
        else:
            self.target.unlink()

    def __exit__(self, *_: object) -> Literal[False]:
        self.close()
        return False
