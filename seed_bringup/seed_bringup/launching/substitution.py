# SPDX-License-Identifier: Apache-2.0
"""Attribute values: $(var x), $(env X default), $(find-pkg-share p), $(dirname) and $(eval '...') replaced."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from seed_bringup.launching.launch_xml import Element, LaunchError
from seed_bringup.launching.packages import package_share

TRUE, FALSE = ("true", "1"), ("false", "0")


class SubstitutionError(LaunchError):
    """What is wrong with a value; whoever knows the line adds it."""


@dataclass
class Scope:
    """What is set where an element stands. Not strict: an attribute that cannot be resolved counts as left out."""

    variables: dict[str, str]
    environment: dict[str, str]
    namespace: str = ""
    strict: bool = True

    def copy(self) -> Scope:
        """A scope of its own for a <group>."""
        return replace(self, variables=dict(self.variables), environment=dict(self.environment))

    def text(self, element: Element, name: str, default: str = "") -> str:
        """An attribute's value with every substitution carried out."""
        if name not in element.attributes:
            return default
        try:
            return substitute(element.attributes[name], self.variables, self.environment, element.file)
        except LaunchError as error:
            if not self.strict:
                return default
            raise element.error(f"{name}: {error}") from error

    def boolean(self, element: Element, name: str, default: bool) -> bool:
        """An attribute that is true or false."""
        text = self.text(element, name, str(default)).strip().lower()
        if text not in TRUE + FALSE and self.strict:
            raise element.error(f"{name}={text!r} must be true, false, 1 or 0")
        return text in TRUE

    def below(self, namespace: str) -> str:
        """A namespace below this one, absolute; one that is absolute already replaces it."""
        if not namespace:
            return self.namespace
        return namespace if namespace.startswith("/") else f"{self.namespace.rstrip('/')}/{namespace.rstrip('/')}"


def substitute(text: str, variables: dict[str, str], environment: dict[str, str], file: Path) -> str:
    """The text with every substitution carried out."""
    return _Reader(text, variables, environment, file).template(end="")


class _Reader:
    """Reads a template from left to right; substitutions nest."""

    def __init__(self, text: str, variables: dict[str, str], environment: dict[str, str], file: Path) -> None:
        self.text = text
        self.variables = variables
        self.environment = environment
        self.file = file
        self.tokens = re.findall(r"\$\(|.", text, re.DOTALL)[::-1]  # "$(" or a character; the next one is last

    def template(self, end: str) -> str:
        """Up to a character of `end` (kept), or to the end of the text when `end` is empty."""
        parts: list[str] = []
        while not self._at(end):
            token = self.tokens.pop()
            if token == "$(":
                token = self._substitution()
            elif token == "\\" and end and self.tokens:
                token = self.tokens.pop()
            parts.append(token)
        return "".join(parts)

    def _at(self, characters: str) -> bool:
        """Whether one of the characters comes next; with none, whether nothing does."""
        if characters and not self.tokens:
            raise SubstitutionError(f"{self.text!r}: a quote or a parenthesis is not closed")
        return self.tokens[-1] in characters if characters else not self.tokens

    def _substitution(self) -> str:
        words: list[str] = []
        while not self._at(")"):
            if self._at("'\""):
                quote = self.tokens.pop()
                words.append(self.template(end=quote))
                self.tokens.pop()
            else:
                words.append(self.template(end=" )"))
            while self._at(" "):
                self.tokens.pop()
        self.tokens.pop()
        return self._evaluate(words)

    def _evaluate(self, words: list[str]) -> str:
        match words:
            case ["var", name]:
                if name in self.variables:
                    return self.variables[name]
                known = ", ".join(sorted(self.variables)) or "none"
                raise SubstitutionError(
                    f"$(var {name}): no <arg> or <let> of that name before this line; so far: {known}"
                )
            case ["env", name, *default] if len(default) < 2:
                if name in self.environment or default:
                    return self.environment.get(name, *default)
                raise SubstitutionError(f"$(env {name}): the environment variable {name} is not set")
            case ["find-pkg-share", package]:
                return str(package_share(package))
            case ["dirname"]:
                return str(self.file.resolve().parent)
            case ["eval", expression]:
                return str(evaluate(expression))
        known = "var NAME, env NAME [DEFAULT], find-pkg-share PACKAGE, dirname, eval 'EXPRESSION'"
        raise SubstitutionError(f"$({' '.join(words)}) is not known; there are: {known}")


# Comparisons, and/or/not and arithmetic on literals: what launch files need. No names, calls or attributes.
_EXPRESSIONS = (ast.List, ast.Tuple, ast.BoolOp, ast.UnaryOp, ast.BinOp, ast.Compare)
_COMPARISONS = (ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.In, ast.NotIn)
_OPERATORS = (*_COMPARISONS, ast.And, ast.Or, ast.Not, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.USub, ast.Load)


def evaluate(expression: str) -> Any:
    """The value of a comparison or of arithmetic on literals; SubstitutionError for everything else."""
    if len(expression) > 1000:
        raise SubstitutionError("$(eval ...): longer than 1000 characters")
    try:
        tree = ast.parse(expression.strip(), mode="eval")
        for node in ast.walk(tree.body):
            if isinstance(node, ast.expr) and not _is_harmless(node):
                hint = " (text needs quotes)" if isinstance(node, ast.Name) else ""
                wrong = ast.unparse(node)
                raise SubstitutionError(f"$(eval ...): {wrong!r} is not a comparison or arithmetic on values{hint}")
        return eval(compile(tree, "<launch file>", "eval"), {"__builtins__": {}})
    except SyntaxError as error:
        raise SubstitutionError(f"$(eval {expression}): {error.msg}") from error
    except (TypeError, ZeroDivisionError) as error:
        raise SubstitutionError(f"$(eval {expression}): {error}") from error


def _is_harmless(node: ast.expr) -> bool:
    """Whether an expression is a literal, or an operation that is allowed; its parts are looked at by themselves."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, str | int | float)
    parts = [part for part in ast.iter_child_nodes(node) if not isinstance(part, ast.expr)]
    return isinstance(node, _EXPRESSIONS) and all(isinstance(part, _OPERATORS) for part in parts)
