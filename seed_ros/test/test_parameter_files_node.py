# SPDX-License-Identifier: Apache-2.0
"""Files of parameters: what is not there, or speaks of other nodes, is refused by the node itself."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter

from seed_core.errors import SeedError
from seed_ros import SeedNode
from seed_ros.parameter_files import matches, sections


@pytest.mark.parametrize(
    ("key", "name", "same"),
    [
        ("/controller", "/controller", True),
        ("/controller", "/left/controller", False),
        ("/**/controller", "/controller", True),
        ("/**/controller", "/left/arm/controller", True),
        ("/*/controller", "/left/controller", True),
        ("/*/controller", "/left/arm/controller", False),
        ("/**", "/left/controller", True),
        ("/left/controller", "/left/controller", True),
        ("/**/controll", "/controller", False),
    ],
)
def test_a_key_is_of_a_node_as_rcl_has_it(key: str, name: str, same: bool) -> None:
    assert matches(key, name) is same


def test_a_value_of_a_file_that_another_one_replaces_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "given.yaml"
    file.write_text("/**:\n  ros__parameters: {law: plain, rate: 1, tiny: 1e-3, grip: {at: [1.0, 2.0]}}\n")
    context, told = Context(), list[str]()
    rclpy.init(args=[], context=context)
    given = {"parameter_files": [str(file)], "law": "seed", "rate": 1.0, "tiny": 1e-3, "grip.at": [1.0, 2.0]}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node = SeedNode("controller", context=context, parameter_overrides=overrides)
    monkeypatch.setattr(node, "get_logger", lambda: SimpleNamespace(warning=told.append))
    try:
        for name in [*given][1:]:
            node.declare_parameter(name, given[name])
        node.refuse_unknown()
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert told == [f"law = seed replaces the plain of {file}: it is given at the start, too"]


def test_keys_may_be_nested() -> None:
    content = {"left": {"controller": {"ros__parameters": {"rate": 1.0}}}, "/**": {"ros__parameters": {}}}
    assert [*sections(content)] == ["/left/controller", "/**"]


@pytest.mark.parametrize(
    ("text", "namespace", "words"),
    [
        (None, "", "no such file"),
        ("controller:\n  ros__parameters: {rate: 1.0}\n", "", ""),
        ("controller:\n  ros__parameters: {rate: 1.0}\n", "/left", "no section for /left/controller"),
        ("/**/controller:\n  ros__parameters: {rate: 1.0}\n", "/left", ""),
        ("estimator:\n  ros__parameters: {rate: 1.0}\n", "", "its sections: '/estimator'"),
        ("rate: 1.0\n", "", "its sections: none"),
        ("rate: [1.0\n", "", "not YAML"),
    ],
)
def test_a_node_refuses_a_file_of_which_it_would_use_nothing(
    tmp_path: Path, text: str | None, namespace: str, words: str
) -> None:
    file = tmp_path / "given.yaml"
    if text is not None:
        file.write_text(text)
    context = Context()
    rclpy.init(args=[], context=context)
    given = [Parameter("parameter_files", value=[str(file)])]
    node = SeedNode("controller", namespace=namespace, context=context, parameter_overrides=given)
    try:
        if words:
            with pytest.raises(SeedError, match=words.replace("'", ".")):
                node.refuse_unknown()
        else:
            node.refuse_unknown()
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
