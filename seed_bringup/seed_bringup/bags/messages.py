# SPDX-License-Identifier: Apache-2.0
"""The Python class of a message type."""

from __future__ import annotations

import importlib
from typing import Any

from seed_bringup.bags.types import BagError


def message_class(name: str) -> Any:
    """The class of a type such as geometry_msgs/msg/Pose."""
    package, _, message = name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), message)
    except (ImportError, AttributeError, ValueError) as error:
        raise BagError(f"message type {name!r} is not installed here: {error}") from error
