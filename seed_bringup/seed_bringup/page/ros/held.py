# SPDX-License-Identifier: Apache-2.0
"""Which tool the controller knows, which another cell may have changed: asked for now and then."""

import contextlib
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.task import Future

from seed_core.errors import SeedError
from seed_core.hand import Frame, Tool

LOOK = 2.0  # [s] between two questions
NAMES = ("tool.name", "tool.T_tip.position", "tool.T_tip.rpy_deg")


class HeldTool:
    """Asks by itself.

    Attributes:
        tool: the last that the controller has named, or None.
    """

    def __init__(self, node: Node) -> None:
        self.tool: Tool | None = None
        self._parameters = node.create_client(GetParameters, "controller/get_parameters")
        self._asked: Any = None
        node.create_timer(LOOK, self._ask)

    def _ask(self) -> None:
        if self._parameters.service_is_ready():
            if self._asked is not None:
                self._parameters.remove_pending_request(self._asked)  # of a controller that hangs: they would pile up
            self._asked = self._parameters.call_async(GetParameters.Request(names=list(NAMES)))
            self._asked.add_done_callback(self._on_tool)

    def _on_tool(self, answer: Future) -> None:
        response = answer.result()
        if response is not None and len(response.values) == 3:
            name, position, turned = response.values
            with contextlib.suppress(SeedError, ValueError):
                x, y, z = position.double_array_value
                roll, pitch, yaw = turned.double_array_value
                self.tool = Tool(name.string_value, Frame((x, y, z), (roll, pitch, yaw)))
