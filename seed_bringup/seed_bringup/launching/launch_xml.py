# SPDX-License-Identifier: Apache-2.0
"""Launch files as XML elements with line numbers; the tags and attributes that they may use."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from seed_core.errors import SeedError


class LaunchError(SeedError):
    """A launch file or its arguments are wrong; the message starts with file and line where there is one."""


@dataclass
class Element:
    """One tag with its attributes, children and place in the file."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)

    def error(self, text: str) -> LaunchError:
        """An error at this tag."""
        return LaunchError(f"{self.file}:{self.line}: {text}")

    def says(self, text: str) -> bool:
        """Whether an attribute of this tag or of one inside has the text."""
        return any(text in value for value in self.attributes.values()) or any(c.says(text) for c in self.children)


COMMON = {"if", "unless"}
NUMBERS = ("respawn_delay", "sigterm_timeout")  # [s] of a node; ROS 2 Jazzy takes them as they stand in the file
ACTIONS = {"arg", "let", "group", "include", "node", "set_env", "unset_env", "push_ros_namespace", "log"}
# tag: (required attributes, further attributes, tags allowed inside)
GRAMMAR: dict[str, tuple[set[str], set[str], set[str]]] = {
    "launch": (set(), {"version"}, ACTIONS),
    "group": (set(), {"scoped"} | COMMON, ACTIONS),
    "arg": ({"name"}, {"default", "description"} | COMMON, {"choice"}),
    "choice": ({"value"}, set(), set()),
    "let": ({"name", "value"}, COMMON, set()),
    "include": ({"file"}, COMMON, {"arg"}),
    "node": (
        {"pkg", "exec"},
        {"name", "namespace", "output", "args", "on_exit", "respawn", "respawn_delay", "sigterm_timeout"} | COMMON,
        {"param", "remap", "env"},
    ),
    "param": (set(), {"name", "value", "value-sep", "type", "from"}, {"param"}),
    "remap": ({"from", "to"}, set(), set()),
    "env": ({"name", "value"}, set(), set()),
    "set_env": ({"name", "value"}, COMMON, set()),
    "unset_env": ({"name"}, COMMON, set()),
    "log": ({"message"}, COMMON, set()),
    "push_ros_namespace": ({"namespace"}, COMMON, set()),
}


def read_launch_file(file: Path) -> Element:
    """The file's <launch> element, every tag and attribute checked."""
    try:
        root = _parse(file)
    except OSError as error:
        raise LaunchError(f"{file}: {error.strerror}") from error
    except expat.ExpatError as error:
        raise LaunchError(f"{file}:{error.lineno}: not XML: {expat.errors.messages[error.code]}") from error
    if root.tag != "launch":
        raise root.error(f"<{root.tag}> is not a launch file; the outermost tag must be <launch>")
    _check(root)
    return root


def _parse(file: Path) -> Element:
    parser = expat.ParserCreate()
    top = Element("", {}, file, 0)
    stack = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, file, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)

    def text(data: str) -> None:
        if data.strip():
            raise stack[-1].error(f"text {data.strip()[:40]!r} between tags; values stand in attributes")

    def doctype(*_: object) -> None:
        raise stack[-1].error("a document type is not accepted in a launch file")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = doctype
    parser.Parse(file.read_bytes(), True)
    return top.children[0]


def _check(element: Element) -> None:
    required, further, inside = GRAMMAR[element.tag]
    for name in element.attributes:
        if name not in required | further:
            known = ", ".join(sorted(required | further)) or "none"
            raise element.error(f"<{element.tag}> has no attribute {name!r}; it takes: {known}")
    for name in NUMBERS:
        if name in element.attributes and not _is_time(element.attributes[name]):
            raise element.error(f"{name}={element.attributes[name]!r} must be a number from 0 on, without $(...)")
    for name in sorted(required - element.attributes.keys()):
        raise element.error(f"<{element.tag}> lacks the attribute {name!r}")
    for child in element.children:
        if child.tag not in inside:
            allowed = ", ".join(f"<{tag}>" for tag in sorted(inside)) or "nothing"
            raise child.error(f"<{child.tag}> is not known inside <{element.tag}>; allowed: {allowed}")
        if element.tag != "include":
            _check(child)
        elif child.attributes.keys() != {"name", "value"}:
            raise child.error("<arg> inside <include> takes name and value, and nothing else")


def _is_time(text: str) -> bool:
    try:
        return float(text) >= 0.0
    except ValueError:
        return False
