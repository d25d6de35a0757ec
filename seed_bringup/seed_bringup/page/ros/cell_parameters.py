# SPDX-License-Identifier: Apache-2.0
"""Which tool the controller knows, and which arm the driver has: asked for now and then, for another cell may come."""

import contextlib
from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.task import Future

from seed_bringup.launching.addresses import is_standin
from seed_core.errors import SeedError
from seed_core.hand import Frame, Tool

LOOK = 2.0  # [s] between two questions
TOOL = ("tool.name", "tool.T_tip.position", "tool.T_tip.rpy_deg")
ARM = ("model", "robot_ip")


class CellParameters:
    """Asks nodes for theirs by itself.

    Attributes:
        tool: the last that the controller has named, or None.
        arm: model and address of the last that the driver has named, or nothing.
        task: that the simulated cell was launched with, or nothing.
    """

    def __init__(self, node: Node) -> None:
        self.forget()
        self._questions = (
            _Question(node, "controller", TOOL, self._on_tool),
            _Question(node, "driver", ARM, self._on_arm),
            _Question(node, "sim", ("task",), self._on_task),
        )
        node.create_timer(LOOK, self._ask)

    def forget(self) -> None:
        """What was named so far."""
        self.tool: Tool | None = None
        self.arm = self.task = ""

    def _ask(self) -> None:
        for question in self._questions:
            question.ask()

    def _on_tool(self, name: Any, position: Any, turned: Any) -> None:
        x, y, z = position.double_array_value
        roll, pitch, yaw = turned.double_array_value
        self.tool = Tool(name.string_value, Frame((x, y, z), (roll, pitch, yaw)))

    def _on_task(self, task: Any) -> None:
        self.task = task.string_value

    def _on_arm(self, model: Any, address: Any) -> None:
        name, at = model.string_value, address.string_value
        self.arm = f"{name.upper().replace('E', 'e')}, {'stand-in' if is_standin(at) else 'robot'} at {at}"


class _Question:
    """Parameters of a node; `hear` gets their values, and may refuse them."""

    def __init__(self, node: Node, other: str, names: tuple[str, ...], hear: Callable[..., None]) -> None:
        self._names, self._hear = names, hear
        self._client = node.create_client(GetParameters, f"{other}/get_parameters")
        self._asked: Future | None = None

    def ask(self) -> None:
        """Ask once more, if the node is there."""
        if self._client.service_is_ready():
            if self._asked is not None:
                self._client.remove_pending_request(self._asked)  # of a node that hangs: they would pile up
            self._asked = self._client.call_async(GetParameters.Request(names=list(self._names)))
            self._asked.add_done_callback(self._on_answer)

    def _on_answer(self, answer: Future) -> None:
        response = answer.result()
        if response is not None and len(response.values) == len(self._names):
            with contextlib.suppress(SeedError, ValueError):
                self._hear(*response.values)
