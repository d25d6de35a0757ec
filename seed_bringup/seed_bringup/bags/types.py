# SPDX-License-Identifier: Apache-2.0
"""Message types as bags need them: definitions and hashes from the installed interface packages."""

from __future__ import annotations

import os
from pathlib import Path

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from seed_core.errors import SeedError


class BagError(SeedError):
    """A bag cannot be written or read; the message says which and why."""


class InstalledTypes:
    """A rosbags type store that grows from the installed .msg files as types are asked for."""

    def __init__(self) -> None:
        self.store: Typestore = get_typestore(Stores.EMPTY)

    def hash(self, name: str) -> str:
        """The type's RIHS01 hash, as DDS discovery and `ros2 bag` know it."""
        self.load(name)
        return self.store.hash_rihs01(name)

    def load(self, name: str) -> None:
        """Register a type such as geometry_msgs/msg/Pose with all that it contains."""
        if name in self.store.fielddefs:
            return
        definitions = get_types_from_msg(definition_file(name).read_text(), name)
        for constants_and_fields in definitions.values():
            for _, description in constants_and_fields[1]:
                _load_contained(self, description)
        self.store.register(definitions)


def _load_contained(types: InstalledTypes, description: tuple) -> None:  # type: ignore[type-arg]
    kind, detail = description
    if kind == Nodetype.NAME:
        types.load(detail)
    elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        _load_contained(types, detail[0])


def definition_file(name: str) -> Path:
    """The .msg file of a type along AMENT_PREFIX_PATH."""
    package, _, message = name.partition("/msg/")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":"):
        file = Path(prefix) / "share" / package / "msg" / f"{message}.msg"
        if prefix and file.is_file():
            return file
    raise BagError(f"message type {name!r} is not installed here; build or install the package {package!r}")
