# SPDX-License-Identifier: Apache-2.0
"""Definitions as Foxglove wants them: the installed .msg files of a type and of all that it contains, in one text."""

from typing import Any

from foxglove import MessageSchema, Schema, ServiceSchema
from rosbags.typesys import get_types_from_msg

from seed_bringup.bags.types import InstalledTypes

_ANSWER = "bool success\nstring message\n"
_PLAY = "string task    # name of a shipped task\nfloat64 force  # [N] of every force in it; 0: its own\n"
_PLAY_TYPE = "seed_bringup/msg/PlayRequest"


def schema_of(types: InstalledTypes, type_name: str) -> Schema:
    """Of a message type such as geometry_msgs/msg/Pose. Raises BagError: not installed here."""
    types.load(type_name)
    text, _ = types.generate_msgdef(type_name, ros_version=2)
    return Schema(name=type_name, encoding="ros2msg", data=text.encode())


def service_schema(button: str) -> ServiceSchema:
    """Of a button: std_srvs/srv/Trigger, but for Play, which takes a task and a force."""
    name, request = ("seed_bringup/srv/Play", _PLAY) if button == "Play" else ("std_srvs/srv/Trigger", "")

    def part(what: str, text: str) -> MessageSchema:
        return MessageSchema(
            encoding="cdr", schema=Schema(name=f"{name}_{what}", encoding="ros2msg", data=text.encode())
        )

    return ServiceSchema(name=name, request=part("Request", request), response=part("Response", _ANSWER))


def read_play(payload: bytes) -> tuple[str, float | None]:
    """Task and force [N], None for its own, of a request in CDR. Raises ValueError: it is none."""
    types = InstalledTypes()
    types.register(get_types_from_msg(_PLAY, _PLAY_TYPE))
    try:
        request: Any = types.deserialize_cdr(payload, _PLAY_TYPE)
    except Exception as error:  # rosbags raises whatever its decoder trips over
        raise ValueError(f"no request of Play: {error}") from error
    return str(request.task), float(request.force) or None
