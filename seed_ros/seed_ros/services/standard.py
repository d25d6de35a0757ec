# SPDX-License-Identifier: Apache-2.0
"""The services that rclpy gives every node, kept from ending it: what rclpy raises on is refused in words.

A parameter of a type that there is not (`value.type = 77`), and a lifecycle transition that is none of the present
state's (activating what is active), leave rclpy's own callbacks as exceptions, which end a node's loop.
A parameter that nobody declared rclpy refuses without its name, or takes it where the name is empty; of one that is
read-only it does not say what to do.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from seed_ros.parameters import no_such_parameter

KNOWN = {kind.value for kind in Parameter.Type}
Answer = Callable[[Any, Any], Any]


def harden_standard_services(node: Node) -> None:
    """Have the node's standard services refuse what would end it."""
    for service in node.services:
        if service.srv_type in (SetParameters, SetParametersAtomically):
            service.callback = partial(_set_parameters, node, service.callback)
        elif service.srv_type is ChangeState:
            service.callback = partial(_change_state, node, service.callback)


def _set_parameters(node: Node, callback: Answer, request: Any, response: Any) -> Any:
    unknown = [p for p in request.parameters if p.value.type not in KNOWN]
    if unknown:
        first = unknown[0]
        reason = (
            f"'{first.name:.60}' is of type {first.value.type}; {min(KNOWN)} to {max(KNOWN)} are known: nothing changed"
        )
        return _refused(reason, request, response)
    impossible = {p.name: why for p in request.parameters if (why := _why_not(node, p.name))}
    if not impossible:
        return callback(request, response)
    if not hasattr(response, "results"):
        return _refused(f"{next(iter(impossible.values()))} Nothing changed", request, response)
    wanted = list(request.parameters)
    request.parameters = [p for p in wanted if p.name not in impossible]
    done = iter(callback(request, response).results)
    response.results = [
        SetParametersResult(successful=False, reason=impossible[p.name]) if p.name in impossible else next(done)
        for p in wanted
    ]
    return response


def _why_not(node: Node, name: str) -> str:
    """Why a parameter cannot be set, whatever its value; '' where it can."""
    if not node.has_parameter(name):
        return no_such_parameter(node, name)
    if node.describe_parameter(name).read_only:
        return (
            f"'{name}' cannot be changed while {node.get_name()} runs: give it at its start, in a launch file or a "
            "file of parameters, and start it again."
        )
    return ""


def _refused(reason: str, request: Any, response: Any) -> Any:
    """No parameter of a request was set."""
    refusal = SetParametersResult(successful=False, reason=reason)
    if hasattr(response, "results"):
        response.results = [refusal] * len(request.parameters)
    else:
        response.result = refusal
    return response


def _change_state(node: Node, callback: Answer, request: Any, response: Any) -> Any:
    """The answer has no words, so they are logged."""
    try:
        return callback(request, response)
    except RuntimeError as error:  # RCLError is one
        wanted = request.transition.label or request.transition.id
        node.get_logger().warning(f"lifecycle transition {wanted!r} is not possible in the present state: {error}")
        response.success = False
        return response
