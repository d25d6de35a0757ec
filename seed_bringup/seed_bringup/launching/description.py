# SPDX-License-Identifier: Apache-2.0
"""Resolves a launch file and its arguments into the list of nodes to start.

Scoping is that of `ros2 launch`: a <group> keeps what is set inside to itself, an <include> does not.
"""

from __future__ import annotations

import difflib
import os
from dataclasses import dataclass, field
from pathlib import Path

from seed_bringup.launching.elements import Element, LaunchError, read_launch_file
from seed_bringup.launching.packages import executable
from seed_bringup.launching.parameters import Parameters, read_parameter
from seed_bringup.launching.substitution import SubstitutionError, substitute

TRUE, FALSE = ("true", "1"), ("false", "0")
MAX_INCLUDES = 20


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
    """What a launch file asks for."""

    nodes: list[Node] = field(default_factory=list)
    arguments: dict[str, Argument] = field(default_factory=dict)


@dataclass
class _Scope:
    variables: dict[str, str]
    environment: dict[str, str]
    namespace: str

    def copy(self) -> _Scope:
        return _Scope(dict(self.variables), dict(self.environment), self.namespace)


def describe(file: Path, arguments: dict[str, str]) -> Description:
    """The nodes that the file starts with these arguments; LaunchError names file and line."""
    description = _resolve(file, arguments, strict=True)
    for name in arguments:
        if name not in description.arguments:
            close = difflib.get_close_matches(name, description.arguments, n=1)
            hint = f"; did you mean {close[0]!r}" if close else ""
            there = ", ".join(sorted(description.arguments)) or "none"
            raise LaunchError(f"{file}: no launch argument {name!r}{hint}. It takes: {there}")
    return description


def declared_arguments(file: Path) -> list[Argument]:
    """The arguments of a file and of what it includes, in order, required ones included."""
    return list(_resolve(file, {}, strict=False).arguments.values())


def _resolve(file: Path, arguments: dict[str, str], strict: bool) -> Description:
    resolver = _Resolver(strict)
    resolver.run(read_launch_file(file), _Scope(dict(arguments), dict(os.environ), ""))
    return resolver.description


class _Resolver:
    """Walks the elements in order; not strict: missing arguments count as empty, conditions on them as true."""

    def __init__(self, strict: bool) -> None:
        self.strict = strict
        self.description = Description()
        self.depth = 0
        self.given_by_include: set[str] = set()

    def run(self, element: Element, scope: _Scope) -> None:
        for child in element.children:
            if self._wanted(child, scope):
                getattr(self, f"_{child.tag}")(child, scope)

    def _text(self, element: Element, name: str, scope: _Scope, default: str = "") -> str:
        if name not in element.attributes:
            return default
        try:
            return substitute(element.attributes[name], scope.variables, scope.environment, element.file)
        except (SubstitutionError, LaunchError) as error:
            if not self.strict:
                return default
            raise element.error(f"{name}: {error}") from error

    def _boolean(self, element: Element, name: str, scope: _Scope, default: bool) -> bool:
        text = self._text(element, name, scope, "true" if default else "false").strip().lower()
        if text not in TRUE + FALSE and self.strict:
            raise element.error(f"{name}={text!r} must be true, false, 1 or 0")
        return text in TRUE

    def _wanted(self, element: Element, scope: _Scope) -> bool:
        if "if" in element.attributes and "unless" in element.attributes:
            raise element.error("if and unless exclude each other")
        if not self.strict and element.tag in ("include", "group", "arg"):
            return True
        return self._boolean(element, "if", scope, True) and not self._boolean(element, "unless", scope, False)

    def _arg(self, element: Element, scope: _Scope) -> None:
        name = element.attributes["name"]
        default = self._text(element, "default", scope) if "default" in element.attributes else None
        choices = tuple(choice.attributes["value"] for choice in element.children)
        if name not in self.given_by_include:
            argument = Argument(name, default, element.attributes.get("description", ""), choices)
            self.description.arguments.setdefault(name, argument)
        if name not in scope.variables:
            if default is None and self.strict:
                raise element.error(f"launch argument {name!r} has no default; give {name}:=VALUE")
            scope.variables[name] = default or ""
        if choices and scope.variables[name] not in choices and self.strict:
            raise element.error(f"{name}:={scope.variables[name]!r} must be one of: {', '.join(choices)}")

    def _let(self, element: Element, scope: _Scope) -> None:
        scope.variables[element.attributes["name"]] = self._text(element, "value", scope)

    def _set_env(self, element: Element, scope: _Scope) -> None:
        scope.environment[element.attributes["name"]] = self._text(element, "value", scope)

    def _unset_env(self, element: Element, scope: _Scope) -> None:
        scope.environment.pop(element.attributes["name"], None)

    def _push_ros_namespace(self, element: Element, scope: _Scope) -> None:
        scope.namespace = _joined(scope.namespace, self._text(element, "namespace", scope))

    def _group(self, element: Element, scope: _Scope) -> None:
        self.run(element, scope.copy() if self._boolean(element, "scoped", scope, True) else scope)

    def _include(self, element: Element, scope: _Scope) -> None:
        file = Path(self._text(element, "file", scope))
        given = {child.attributes["name"]: self._text(child, "value", scope) for child in element.children}
        if self.depth >= MAX_INCLUDES:
            raise element.error(f"more than {MAX_INCLUDES} launch files include each other")
        if not file.is_file():
            if not self.strict:
                return
            raise element.error(f"file={str(file)!r}: no such launch file")
        scope.variables.update(given)
        before, self.given_by_include = self.given_by_include, self.given_by_include | given.keys()
        self.depth += 1
        self.run(read_launch_file(file), scope)
        self.depth -= 1
        self.given_by_include = before

    def _node(self, element: Element, scope: _Scope) -> None:
        if not self.strict:
            return
        on_exit = element.attributes.get("on_exit", "")
        if on_exit not in ("", "shutdown"):
            raise element.error(f"on_exit={on_exit!r} must be 'shutdown' or left out")
        self.description.nodes.append(
            Node(
                executable=self._executable(element, scope),
                name=self._text(element, "name", scope),
                namespace=_joined(scope.namespace, self._text(element, "namespace", scope)),
                arguments=tuple(self._text(element, "args", scope).split()),
                parameters=tuple(self._parameter(p, scope) for p in element.children if p.tag == "param"),
                remappings=tuple(
                    (self._text(r, "from", scope), self._text(r, "to", scope))
                    for r in element.children
                    if r.tag == "remap"
                ),
                environment=self._environment(element, scope),
                shutdown_on_exit=on_exit == "shutdown",
                respawn=self._boolean(element, "respawn", scope, False),
                respawn_delay=float(self._text(element, "respawn_delay", scope, "0")),
                origin=f"{element.file}:{element.line}",
            )
        )

    def _executable(self, element: Element, scope: _Scope) -> Path:
        try:
            return executable(self._text(element, "pkg", scope), self._text(element, "exec", scope))
        except LaunchError as error:
            raise element.error(str(error)) from error

    def _environment(self, element: Element, scope: _Scope) -> dict[str, str]:
        own = {e.attributes["name"]: self._text(e, "value", scope) for e in element.children if e.tag == "env"}
        return scope.environment | own

    def _parameter(self, element: Element, scope: _Scope) -> Parameters:
        return read_parameter(element, lambda e, name: self._text(e, name, scope))


def _joined(outer: str, inner: str) -> str:
    """A namespace below another one, absolute; one that is absolute already replaces the outer."""
    if not inner:
        return outer
    return inner if inner.startswith("/") else f"{outer.rstrip('/')}/{inner.rstrip('/')}"
