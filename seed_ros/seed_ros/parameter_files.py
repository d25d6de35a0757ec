# SPDX-License-Identifier: Apache-2.0
"""Files of parameters that a node is meant to read: there they are, and they speak of this node.

`ros2 launch` passes over a file that does not exist, and rcl over a section whose key is not this node's full name, so
that a node in a namespace ignores `controller:` in silence. A launch file names its files in `parameter_files` too.
"""

import itertools
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from seed_core.config import ConfigError

NAME = "parameter_files"
OPTION = "--params-file"
SECTION = "ros__parameters"


def check_files(node: Node) -> dict[str, tuple[Any, str]]:
    """Declare `parameter_files`, and check those files and the ones on the command line.

    Returns:
        What `parameter_files` say of this node: value and file by the parameter's name; the last file counts.

    Raises:
        ConfigError: one is missing, is not YAML, or has a section for a node of this name in another namespace only; or
            one of `parameter_files` says nothing to this node.
    """
    words = "files that this node must have been given: one that is missing or speaks of other nodes alone is refused"
    wanted = node.declare_parameter(NAME, [""], ParameterDescriptor(description=words, read_only=True)).value
    name = node.get_fully_qualified_name()
    said: dict[str, tuple[Any, str]] = {}
    for file in filter(None, wanted):
        content = _check(Path(file), name, must_speak=True)
        said |= {parameter: (value, file) for parameter, value in _values(content, name)}
    for file in _on_command_line(sys.argv):
        _check(Path(file), name, must_speak=False)
    return said


def _on_command_line(words: Sequence[str]) -> Iterator[str]:
    return (file for word, file in itertools.pairwise(words) if word == OPTION)


def _check(file: Path, name: str, must_speak: bool) -> Any:
    """The content of a file that speaks of the node with this full name, or of no node of its name elsewhere."""
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{file}: no such file of parameters") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: cannot be read: {error}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{file}: not YAML: {' '.join(str(error).split())}") from error
    keys = [*sections(content)]
    if any(matches(key, name) for key in keys):
        return content
    own = name.rsplit("/", 1)[1]
    if must_speak or any(key.rsplit("/", 1)[-1] == own for key in keys):
        there = ", ".join(f"'{key}'" for key in keys) or "none"
        raise ConfigError(
            f"{file}: no section for {name}, so none of it would be used; its sections: {there}; "
            f"give a copy of it with '/**/{own}:' for this node in any namespace, or '/**:' for every node"
        )
    return content


def sections(content: Any, above: str = "") -> Iterator[str]:
    """Keys of the sections of a file's content, namespaces and node in one, with a slash in front."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        if key == SECTION:
            yield above
        else:
            yield from sections(value, f"{above}/{str(key).strip('/')}")


def _values(content: Any, name: str, above: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values of the parameters in all sections of the node with this full name."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        if key != SECTION:
            yield from _values(value, name, f"{above}/{str(key).strip('/')}")
        elif matches(above, name):
            yield from _flat(value)


def _flat(values: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(values, dict):
        yield prefix.removesuffix("."), values
        return
    for key, value in values.items():
        yield from _flat(value, f"{prefix}{key}.")


def matches(key: str, name: str) -> bool:
    """Whether a section's key is of the node with this full name; * is one token of it, ** any number."""
    return re.fullmatch("".join(_patterns(key.strip("/").split("/"))), name) is not None


def _patterns(tokens: Iterable[str]) -> Iterator[str]:
    for token in tokens:
        yield "(/[^/]+)*" if token == "**" else "/[^/]+" if token == "*" else "/" + re.escape(token)
