# SPDX-License-Identifier: Apache-2.0
"""$(var x), $(env X default), $(find-pkg-share p), $(dirname) and $(eval '...') in attribute values."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from seed_bringup.launching.packages import package_share


class SubstitutionError(Exception):
    """What is wrong with a value; whoever knows the line adds it."""


def substitute(text: str, variables: Mapping[str, str], environment: Mapping[str, str], file: Path) -> str:
    """The text with every substitution carried out."""
    return _Reader(text, variables, environment, file).template(end="")


class _Reader:
    """Reads a template from left to right; substitutions nest."""

    def __init__(self, text: str, variables: Mapping[str, str], environment: Mapping[str, str], file: Path) -> None:
        self.text = text
        self.variables = variables
        self.environment = environment
        self.file = file
        self.at = 0

    def template(self, end: str) -> str:
        """Up to an unescaped character of `end` (kept), or to the end of the text when `end` is empty."""
        parts: list[str] = []
        while self.at < len(self.text):
            if self.text.startswith("$(", self.at):
                parts.append(self._substitution())
                continue
            character = self.text[self.at]
            if character in end:
                return "".join(parts)
            if character == "\\" and end and self.at + 1 < len(self.text):
                self.at += 1
                character = self.text[self.at]
            parts.append(character)
            self.at += 1
        if end:
            raise SubstitutionError(f"{self.text!r}: a quote or a parenthesis is not closed")
        return "".join(parts)

    def _substitution(self) -> str:
        self.at += len("$(")
        arguments: list[str] = []
        while not self.text.startswith(")", self.at):
            arguments.append(self._argument())
            while self.text.startswith(" ", self.at):
                self.at += 1
        self.at += 1
        return self._evaluate(arguments)

    def _argument(self) -> str:
        quote = self.text[self.at : self.at + 1]
        if quote not in ("'", '"') or not quote:
            return self.template(end=" )")
        self.at += 1
        value = self.template(end=quote)
        self.at += 1
        return value

    def _evaluate(self, words: list[str]) -> str:
        name, arguments = (words[0], words[1:]) if words else ("", [])
        match name, arguments:
            case "var", [variable]:
                return self._variable(variable)
            case "env", [variable, *default] if len(default) < 2:
                return self._environment(variable, default)
            case "find-pkg-share", [package]:
                return str(package_share(package))
            case "dirname", []:
                return str(self.file.resolve().parent)
            case "eval", [expression]:
                return str(evaluate(expression))
        known = "var NAME, env NAME [DEFAULT], find-pkg-share PACKAGE, dirname, eval 'EXPRESSION'"
        raise SubstitutionError(f"$({' '.join(words)}) is not known; there are: {known}")

    def _variable(self, name: str) -> str:
        if name not in self.variables:
            known = ", ".join(sorted(self.variables)) or "none"
            raise SubstitutionError(f"$(var {name}): no <arg> or <let> of that name before this line; so far: {known}")
        return self.variables[name]

    def _environment(self, name: str, default: list[str]) -> str:
        if name in self.environment:
            return self.environment[name]
        if not default:
            raise SubstitutionError(f"$(env {name}): the environment variable {name} is not set")
        return default[0]


_OPERATIONS: dict[type, Callable[..., Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Not: operator.not_,
    ast.USub: operator.neg,
}


def evaluate(expression: str) -> Any:
    """Comparisons, and/or/not and arithmetic on literals: what launch files need, and no code."""
    if len(expression) > 1000:
        raise SubstitutionError("$(eval ...): longer than 1000 characters")
    try:
        return _value(ast.parse(expression.strip(), mode="eval").body)
    except SyntaxError as error:
        raise SubstitutionError(f"$(eval {expression}): {error.msg}") from error
    except (TypeError, ZeroDivisionError) as error:
        raise SubstitutionError(f"$(eval {expression}): {error}") from error


def _value(node: ast.expr) -> Any:
    match node:
        case ast.Constant(value=value) if isinstance(value, str | int | float):
            return value
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [_value(item) for item in items]
        case ast.BoolOp(op=ast.And(), values=values):
            return all(_value(v) for v in values)
        case ast.BoolOp(op=ast.Or(), values=values):
            return any(_value(v) for v in values)
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATIONS:
            return _OPERATIONS[type(op)](_value(operand))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
            return _OPERATIONS[type(op)](_value(left), _value(right))
        case ast.Compare(left=left, ops=ops, comparators=rights) if all(type(o) in _OPERATIONS for o in ops):
            values = [_value(left), *(_value(r) for r in rights)]
            return all(_OPERATIONS[type(o)](a, b) for o, a, b in zip(ops, values, values[1:], strict=False))
    hint = " (text needs quotes)" if isinstance(node, ast.Name) else ""
    raise SubstitutionError(f"$(eval ...): {ast.unparse(node)!r} is not a comparison or arithmetic on values{hint}")
