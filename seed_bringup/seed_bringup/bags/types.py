# SPDX-License-Identifier: Apache-2.0
"""Message types as bags need them: Python classes, definitions and hashes of the installed interface packages.

Not those that rosbags carries of each ROS 2 release: a bag may hold messages of any package, and its hashes must be
those of what is installed.
"""

import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from seed_bringup.bags import BagError


class InstalledTypes(Typestore):
    """A rosbags type store that grows from the installed .msg files as types are asked for."""

    def hash(self, name: str) -> str:
        """The type's RIHS01 hash, as DDS discovery and `ros2 bag` know it."""
        self.load(name)
        return self.hash_rihs01(name)

    def load(self, name: str) -> None:
        """Register a type such as geometry_msgs/msg/Pose with all that it contains."""
        missing = [name]
        while missing:
            name = missing.pop()
            if name not in self.fielddefs:
                definitions = get_types_from_msg(definition_file(name).read_text(), name)
                self.register(definitions)
                missing += [t for _, fields in definitions.values() for _, kind in fields for t in _contained(*kind)]


def _contained(kind: Nodetype, detail: Any) -> Iterator[str]:
    """The message types that a field of this kind holds."""
    if kind == Nodetype.NAME:
        yield detail
    elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        yield from _contained(*detail[0])


def is_feedback(name: str) -> bool:
    """Whether a type is of an action's feedback: no message that a bag could define."""
    return "/action/" in name


def _parts(name: str) -> tuple[str, str]:
    """Package and message of a type."""
    if is_feedback(name):
        raise BagError(f"{name} is the feedback of an action, not a message type of its own")
    package, _, message = name.partition("/msg/")
    return package, message


def definition_file(name: str) -> Path:
    """The .msg file of a type along AMENT_PREFIX_PATH."""
    package, message = _parts(name)
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":"):
        file = Path(prefix, "share", package, "msg", f"{message}.msg")
        if prefix and file.is_file():
            return file
    raise BagError(f"message type {name!r} is not installed here; build or install the package {package!r}")


def message_class(name: str) -> Any:
    """The Python class of a type such as geometry_msgs/msg/Pose."""
    package, message = _parts(name)
    try:
        return getattr(importlib.import_module(f"{package}.msg"), message)
    except (ImportError, AttributeError, ValueError) as error:
        raise BagError(f"message type {name!r} is not installed here: {error}") from error
