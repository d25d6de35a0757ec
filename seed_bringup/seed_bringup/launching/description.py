# SPDX-License-Identifier: Apache-2.0
"""Resolves a launch file and its arguments into the list of nodes to start.

Scoping is that of `ros2 launch`: a <group> keeps what is set inside to itself, an <include> does not.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path

from seed_bringup.launching.launch_xml import Element, LaunchError, read_launch_file
from seed_bringup.launching.packages import executable
from seed_bringup.launching.parameters import Parameters, read_parameter
from seed_bringup.launching.substitution import Scope
from seed_core.program.suggestions import did_you_mean

MAX_INCLUDES = 20
TERM_AFTER = 3.0  # [s] after the interrupt, unless a node asks for more


@dataclass(frozen=True)
class Node:
    """One process to start. `parameters` holds dictionaries and names of files, later ones win."""

    executable: Path
    name: str
    namespace: str
    arguments: tuple[str, ...]
    parameters: tuple[Parameters, ...]
    remappings: tuple[tuple[str, str], ...]
    environment: dict[str, str]
    shutdown_on_exit: bool
    respawn: bool
    respawn_delay: float  # [s]
    sigterm_timeout: float  # [s] that it may take to end after an interrupt
    origin: str

    @property
    def label(self) -> str:
        """What its output is marked with."""
        return self.name or self.executable.name


@dataclass(frozen=True)
class Argument:
    """A declared launch argument."""

    name: str
    default: str | None
    description: str
    choices: tuple[str, ...]


@dataclass
class Description:
    """What a launch file asks for; messages: what it says to whoever starts it; variables: as they are at its end."""

    nodes: list[Node] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    arguments: dict[str, Argument] = field(default_factory=dict)
    variables: dict[str, str] = field(default_factory=dict)


def describe(file: Path, arguments: dict[str, str]) -> Description:
    """The nodes that the file starts with these arguments; LaunchError names file and line."""
    description = _resolve(file, arguments, strict=True)
    for name in arguments:
        if name not in description.arguments:
            there = ", ".join(sorted(description.arguments)) or "none"
            meant = did_you_mean(name, description.arguments)
            raise LaunchError(f"{file}: no launch argument {name!r}. It takes: {there}{meant}")
    return description


def declared_arguments(file: Path) -> list[Argument]:
    """The arguments of a file and of what it includes, in order, required ones included."""
    return list(_resolve(file, {}, strict=False).arguments.values())


def _resolve(file: Path, arguments: dict[str, str], strict: bool) -> Description:
    """Not strict: missing arguments count as empty, conditions on them as true."""
    resolver = _Resolver(file)
    scope = Scope(dict(arguments), dict(os.environ), strict=strict)
    resolver.run(read_launch_file(file), scope)
    resolver.description.variables = scope.variables
    return resolver.description


class _Resolver:
    """Walks the elements in order; the method _TAG carries out the element <TAG>."""

    def __init__(self, file: Path) -> None:
        self.description = Description()
        self.folder = file.resolve().parent  # of the file begun last: $(dirname) to ROS 2 Jazzy, even after its end
        self.depth = 0
        self.given_by_include: set[str] = set()

    def run(self, element: Element, scope: Scope) -> None:
        for child in element.children:
            if self._wanted(child, scope):
                if self.folder != child.file.resolve().parent and child.says("$(dirname)"):
                    raise child.error(
                        f"$(dirname) after an <include> is the folder of what was included ({self.folder}) in ROS 2 "
                        "Jazzy: write $(find-pkg-share PACKAGE)/..."
                    )
                getattr(self, f"_{child.tag}")(child, scope)

    def _wanted(self, element: Element, scope: Scope) -> bool:
        if "if" in element.attributes and "unless" in element.attributes:
            raise element.error("if and unless exclude each other")
        if not scope.strict and element.tag in ("include", "group", "arg"):
            return True
        return scope.boolean(element, "if", True) and not scope.boolean(element, "unless", False)

    def _arg(self, element: Element, scope: Scope) -> None:
        name = element.attributes["name"]
        default = scope.text(element, "default") if "default" in element.attributes else None
        choices = tuple(choice.attributes["value"] for choice in element.children)
        if name not in self.given_by_include:
            argument = Argument(name, default, element.attributes.get("description", ""), choices)
            self.description.arguments.setdefault(name, argument)
        if name not in scope.variables:
            if default is None and scope.strict:
                raise element.error(f"launch argument {name!r} has no default; give {name}:=VALUE")
            scope.variables[name] = default or ""
        if choices and scope.variables[name] not in choices and scope.strict:
            value = scope.variables[name]
            raise element.error(f"{name}:={value!r} must be one of: {', '.join(choices)}{did_you_mean(value, choices)}")

    def _let(self, element: Element, scope: Scope) -> None:
        scope.variables[element.attributes["name"]] = scope.text(element, "value")

    def _set_env(self, element: Element, scope: Scope) -> None:
        scope.environment[scope.text(element, "name")] = scope.text(element, "value")

    def _unset_env(self, element: Element, scope: Scope) -> None:
        scope.environment.pop(scope.text(element, "name"), None)

    def _log(self, element: Element, scope: Scope) -> None:
        self.description.messages.append(scope.text(element, "message"))

    def _push_ros_namespace(self, element: Element, scope: Scope) -> None:
        scope.namespace = scope.below(scope.text(element, "namespace"))

    def _group(self, element: Element, scope: Scope) -> None:
        self.run(element, scope.copy() if scope.boolean(element, "scoped", True) else scope)

    def _include(self, element: Element, scope: Scope) -> None:
        file = Path(scope.text(element, "file"))
        given = {child.attributes["name"]: scope.text(child, "value") for child in element.children}
        if self.depth >= MAX_INCLUDES:
            raise element.error(f"more than {MAX_INCLUDES} launch files include each other")
        if not file.is_file():
            if not scope.strict:
                return
            raise element.error(f"file={str(file)!r}: no such launch file")
        scope.variables.update(given)
        before, self.given_by_include = self.given_by_include, self.given_by_include | given.keys()
        self.depth += 1
        self.folder = file.resolve().parent
        self.run(read_launch_file(file), scope)
        self.depth -= 1
        self.given_by_include = before

    def _node(self, element: Element, scope: Scope) -> None:
        if not scope.strict:
            return
        on_exit = element.attributes.get("on_exit", "")
        if on_exit not in ("", "shutdown"):
            raise element.error(f"on_exit={on_exit!r} must be 'shutdown' or left out")
        package, program_name = scope.text(element, "pkg"), scope.text(element, "exec")
        try:
            program = executable(package, program_name)
        except LaunchError as error:
            raise element.error(str(error)) from error
        inside = {tag: [c for c in element.children if c.tag == tag] for tag in ("param", "remap", "env")}
        own_environment = {scope.text(e, "name"): scope.text(e, "value") for e in inside["env"]}
        node = Node(
            executable=program,
            name=scope.text(element, "name"),
            namespace=scope.below(scope.text(element, "namespace")),
            arguments=tuple(scope.text(element, "args").split()),
            parameters=tuple(read_parameter(p, scope) for p in inside["param"]),
            remappings=tuple((scope.text(r, "from"), scope.text(r, "to")) for r in inside["remap"]),
            environment=scope.environment | own_environment,
            shutdown_on_exit=on_exit == "shutdown",
            respawn=scope.boolean(element, "respawn", False),
            respawn_delay=float(element.attributes.get("respawn_delay", 0.0)),
            sigterm_timeout=self._sigterm_timeout(element, scope),
            origin=f"{element.file}:{element.line}",
        )
        self.description.nodes.append(node)

    @staticmethod
    def _sigterm_timeout(element: Element, scope: Scope) -> float:
        """[s] of a node's own attribute, or of the variable `sigterm_timeout`, which is that of all nodes."""
        text = element.attributes.get("sigterm_timeout", scope.variables.get("sigterm_timeout", str(TERM_AFTER)))
        try:
            return float(text)
        except ValueError as error:
            raise element.error(f"sigterm_timeout:={text!r} must be a number [s]") from error
