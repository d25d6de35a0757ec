# SPDX-License-Identifier: Apache-2.0
"""What rclpy itself raises on in its services is refused, and the node goes on."""

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterDescriptor, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.lifecycle import LifecycleNode

from seed_ros.loop import FixedRateLoop
from seed_ros.node import SeedNode
from seed_ros.testing import Bench

pytestmark = pytest.mark.ros


class Plain(SeedNode, LifecycleNode):
    def __init__(self, **arguments: Any) -> None:
        super().__init__("plain", **arguments)
        self.declare_parameter("speed", 1.0)
        self.declare_parameter("rate", 100.0, ParameterDescriptor(read_only=True))
        self.loop = FixedRateLoop(self, 100.0, lambda: None, service_period=0.0)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    made.add(Plain)
    yield made
    made.close()


def test_a_parameter_of_a_type_that_there_is_not_is_refused(bench: Bench) -> None:
    wrong = Parameter(name="speed", value=ParameterValue(type=77))
    good = Parameter(name="speed", value=ParameterValue(type=3, double_value=2.0))
    answer = bench.call(SetParameters, "plain/set_parameters", SetParameters.Request(parameters=[good, wrong]))
    assert [r.successful for r in answer.results] == [False, False]
    assert "'speed' is of type 77" in answer.results[0].reason
    request = SetParametersAtomically.Request(parameters=[wrong])
    assert not bench.call(SetParametersAtomically, "plain/set_parameters_atomically", request).result.successful
    answer = bench.call(SetParameters, "plain/set_parameters", SetParameters.Request(parameters=[good]))
    assert answer.results[0].successful


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("spede", "did you mean speed?"),
        ("", "docs/interfaces.md lists those that there are"),
        ("zzz", "docs/interfaces.md lists those that there are"),
    ],
)
def test_a_parameter_that_nobody_declared_is_refused_by_name(bench: Bench, name: str, hint: str) -> None:
    wrong = Parameter(name=name, value=ParameterValue(type=3, double_value=2.0))
    good = Parameter(name="speed", value=ParameterValue(type=3, double_value=2.0))
    answer = bench.call(SetParameters, "plain/set_parameters", SetParameters.Request(parameters=[wrong, good, wrong]))
    assert [r.successful for r in answer.results] == [False, True, False]
    assert answer.results[0].reason == f"plain has no parameter '{name}'; {hint}"
    request = SetParametersAtomically.Request(parameters=[good, wrong])
    answer = bench.call(SetParametersAtomically, "plain/set_parameters_atomically", request)
    assert not answer.result.successful
    assert f"plain has no parameter '{name}'" in answer.result.reason


def test_a_parameter_that_is_only_read_at_the_start_is_refused_with_what_to_do(bench: Bench) -> None:
    fixed = Parameter(name="rate", value=ParameterValue(type=3, double_value=2.0))
    good = Parameter(name="speed", value=ParameterValue(type=3, double_value=2.0))
    answer = bench.call(SetParameters, "plain/set_parameters", SetParameters.Request(parameters=[fixed, good]))
    assert [r.successful for r in answer.results] == [False, True]
    words = "'rate' cannot be changed while plain runs: give it at its start, in a launch file or a file of parameters"
    assert answer.results[0].reason == f"{words}, and start it again."


def test_a_transition_out_of_place_is_refused(bench: Bench) -> None:
    def change(number: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=number))
        return bool(bench.call(ChangeState, "plain/change_state", request).success)

    assert not change(Transition.TRANSITION_ACTIVATE)  # not configured yet
    assert not change(200)
    assert change(Transition.TRANSITION_CONFIGURE)
    assert not change(Transition.TRANSITION_CONFIGURE)
