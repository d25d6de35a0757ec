# SPDX-License-Identifier: Apache-2.0
"""<param> of a launch file: a file of parameters, or a name with a typed value."""

from pathlib import Path
from typing import Any

import yaml

from seed_bringup.launching.launch_xml import Element
from seed_bringup.launching.substitution import Scope

Parameters = dict[str, Any] | Path
TYPES: dict[str, type] = {"int": int, "float": float, "str": str, "bool": bool}


def read_parameter(element: Element, scope: Scope) -> Parameters:
    """The dictionary of one <param>, or the path of its file."""
    if "from" not in element.attributes:
        return _named(element, scope)
    file = Path(scope.text(element, "from"))
    if not file.is_file():
        raise element.error(f"from={str(file)!r}: no such parameter file")
    return file


def _named(element: Element, scope: Scope) -> dict[str, Any]:
    name = scope.text(element, "name")
    if not name or ("value" in element.attributes) == bool(element.children):
        raise element.error("<param> takes either from, or name with value, or name with <param> inside")
    if not element.children:
        return {name: _typed(element, scope.text(element, "value"))}
    nested: dict[str, Any] = {}
    for child in element.children:
        nested |= _named(child, scope)
    return {name: nested}


def _typed(element: Element, text: str) -> Any:
    """A parameter's value by YAML's rules, as `ros2 launch` reads it, or as the type asked for."""
    if "value-sep" in element.attributes:
        return [_scalar(element, item) for item in text.split(element.attributes["value-sep"])]
    wanted = element.attributes.get("type")
    if wanted is None:
        return _scalar(element, text)
    if wanted not in TYPES:
        raise element.error(f"type={wanted!r} must be one of: {', '.join(TYPES)}")
    value = text if wanted == "str" else _scalar(element, text)
    if wanted == "float" and type(value) is int:
        value = float(value)
    if type(value) is not TYPES[wanted]:
        raise element.error(f"value={text!r} is no {wanted}")
    return value


def _scalar(element: Element, text: str) -> Any:
    try:
        value = yaml.safe_load(text) if text else text
    except yaml.YAMLError as error:
        raise element.error(f"value={text!r} is not YAML: {error}") from error
    if not isinstance(value, str | int | float | list):
        raise element.error(f"value={text!r} must be a number, a text, a boolean or a list of them")
    return value
