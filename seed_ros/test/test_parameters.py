# SPDX-License-Identifier: Apache-2.0
"""ROS parameters follow the dataclass: names, defaults, bounds, live changes."""

from collections.abc import Iterator
from dataclasses import dataclass

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.context import Context  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from seed_core.config import ConfigError, field  # noqa: E402
from seed_core.hand import Hand  # noqa: E402
from seed_ros import SeedNode  # noqa: E402
from seed_ros.parameters import declare, refuse_unknown  # noqa: E402

pytestmark = pytest.mark.ros


@dataclass(frozen=True)
class Settings:
    speed: float = field(0.1, unit="m/s", low=0.0, high=0.5, doc="of the approach")
    count: int = field(3, low=1, high=9, doc="images in a row")
    method: str = field("rigid_fit", choices=("rigid_fit", "published"), doc="estimator")
    low: tuple[float, float, float] = field((0.0, 1.0, 2.0), unit="m", doc="corner")
    on: bool = field(True, doc="whether")


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context)
    yield context
    rclpy.try_shutdown(context=context)


def make(context: Context, **given: object) -> Node:
    overrides = [Parameter(name.replace("__", "."), value=value) for name, value in given.items()]
    return Node("under_test", context=context, parameter_overrides=overrides)


def test_every_field_becomes_a_parameter_with_unit_and_bounds(context: Context) -> None:
    node = make(context, speed=0.3, count=5)
    settings = declare(node, Settings(), "approach")
    assert settings == Settings()  # the names are below the prefix, so nothing was given
    names = {f"approach.{n}" for n in ("speed", "count", "method", "low", "on")}
    assert all(node.has_parameter(n) for n in names)
    described = node.describe_parameter("approach.speed")
    assert described.description == "of the approach [m/s], 0 to 0.5"
    assert "one of: rigid_fit, published" in node.describe_parameter("approach.method").additional_constraints


def test_values_given_from_outside_are_taken_and_whole_numbers_count_as_floats(context: Context) -> None:
    node = make(context, speed=0, low=[1, 2, 3], method="published")
    assert declare(node, Settings()) == Settings(speed=0.0, low=(1.0, 2.0, 3.0), method="published")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"speed": 0.6}, "speed = 0.6 m/s must be within 0 and 0.5 m/s"),
        ({"speed": float("nan")}, "speed = nan m/s must be finite"),
        ({"speed": "fast"}, "speed = 'fast' must be a number"),
        ({"count": 2.5}, "count = 2.5 must be a whole number"),
        ({"method": "best"}, "method = 'best' must be one of: rigid_fit, published"),
        ({"low": [1.0, 2.0]}, "low has 2 values; it needs 3"),
        ({"low": [1.0, 2.0, float("inf")]}, r"low\[2\] = inf m must be finite"),
    ],
)
def test_a_bad_value_is_refused_with_name_value_unit_and_bound(
    context: Context, given: dict[str, object], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        declare(make(context, **given), Settings())


def test_a_parameter_that_nobody_declared_is_refused_with_the_nearest_name(context: Context) -> None:
    node = make(context, sped=0.2)
    declare(node, Settings())
    with pytest.raises(ConfigError, match="no parameter 'sped'; did you mean speed"):
        refuse_unknown(node)


def test_a_former_name_is_refused_with_the_new_one(context: Context) -> None:
    node = make(context, max_turning=0.2)
    declare(node, Settings())
    with pytest.raises(ConfigError, match="no parameter 'max_turning'; it is called max_angular_speed now"):
        refuse_unknown(node)


def test_live_changes_are_checked_as_a_whole_before_they_are_used(context: Context) -> None:
    node, seen = make(context), []
    declare(node, Settings(), live=("speed", "method"), on_change=seen.append)
    assert node.set_parameters([Parameter("speed", value=0.4)])[0].successful
    assert seen == [Settings(speed=0.4)]
    bad = node.set_parameters([Parameter("speed", value=7.0)])[0]
    assert not bad.successful
    assert "within 0 and 0.5 m/s" in bad.reason
    assert not node.set_parameters([Parameter("count", value=4)])[0].successful  # read-only
    assert len(seen) == 1
    assert node.get_parameter("speed").value == 0.4


def test_nested_frames_of_a_hand_are_parameters_too(context: Context) -> None:
    node = make(context, hand__E_C__position=[0.0, 0.0, 0.2])
    hand = declare(node, Hand(), "hand")
    assert hand.X_EC[2, 3] == 0.2
    assert hand.C_L == Hand().C_L


def test_the_bounds_are_told_as_ranges_and_a_value_beyond_is_refused_by_our_own_words(context: Context) -> None:
    node = SeedNode("n", context=context)
    try:
        declare(node, Settings(), live=("speed",))
        speed, count, on = node.describe_parameters(["speed", "count", "on"])
        assert (speed.floating_point_range[0].from_value, speed.floating_point_range[0].to_value) == (0.0, 0.5)
        assert (count.integer_range[0].from_value, count.integer_range[0].to_value) == (1, 9)
        assert not on.integer_range
        assert not on.floating_point_range
        (result,) = node.set_parameters([Parameter("speed", value=0.6)])
        assert not result.successful
        assert "speed = 0.6 m/s" in result.reason
    finally:
        node.destroy_node()
