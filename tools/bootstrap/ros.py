# SPDX-License-Identifier: Apache-2.0
"""Which ROS 2 to use: a sourced one, an installed one, else the wheels."""

import os
import re
from pathlib import Path
from typing import NamedTuple

from progress import UsageError, say

INSTALLED = ("jazzy", "kilted", "lyrical", "rolling")  # in order of preference; older ones lack Python 3.11


class Ros(NamedTuple):
    """A ROS 2: prefix None means the wheels; underlays are the sourced prefixes, nearest first."""

    prefix: Path | None
    python: tuple[int, int] | None
    underlays: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """`wheels`, or the name of the distribution."""
        return "wheels" if self.prefix is None else self.prefix.name


WHEELS = Ros(None, None)


def entries(variable: str) -> tuple[str, ...]:
    """The entries of a search path."""
    return tuple(entry for entry in os.environ.get(variable, "").split(":") if entry)


def find_ros() -> Ros:
    """Obey SEED_ROS; else take what is sourced, what is installed, or the wheels."""
    wanted = os.environ.get("SEED_ROS", "")
    if wanted == "wheels":
        return WHEELS
    if wanted:
        found = _ros_at(Path(wanted))
        if found is None:
            raise UsageError(
                f"SEED_ROS={wanted}: no ROS 2 with setup.bash and rclpy there; name its prefix, or 'wheels'"
            )
        return found._replace(underlays=entries("SEED_UNDERLAYS"))
    sourced = entries("AMENT_PREFIX_PATH")
    for found in filter(None, (_ros_at(Path(prefix)) for prefix in sourced)):
        if found.python >= (3, 11):
            return found._replace(underlays=sourced)
        say(f"the sourced ROS 2 at {found.prefix} has Python 3.{found.python[1]}; 3.11 is needed: looking on")
    installed = (_ros_at(Path("/opt/ros", name)) for name in INSTALLED)
    return next(filter(None, installed), WHEELS)


def _ros_at(prefix: Path) -> Ros | None:
    """The ROS 2 at a prefix, with the Python that its rclpy is built for."""
    if not (prefix / "setup.bash").is_file():
        return None
    for rclpy in sorted(prefix.glob("lib/python3.*/site-packages/rclpy")):
        match = re.fullmatch(r"python3\.(\d+)", rclpy.parents[1].name)
        if match:
            return Ros(prefix, (3, int(match[1])))
    return None


def lies_in(entry: str, *folders: object) -> bool:
    """Whether an entry of a search path is one of the folders or below one."""
    return any(Path(entry).is_relative_to(str(folder)) for folder in folders)


def foreign(entry: str) -> bool:
    """Whether an entry of a search path belongs to a ROS 2 that the wheels must not see."""
    return lies_in(entry, "/opt/ros", *entries("AMENT_PREFIX_PATH"))
