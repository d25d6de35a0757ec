# SPDX-License-Identifier: Apache-2.0
"""Real nodes in one test process: each node's loop turned by hand, together with a client node."""

import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from seed_ros.loop import FixedRateLoop


class Bench:
    """A context with nodes under test and a client; close() ends all of it."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context)
        self.client = Node("client", context=self.context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.client)
        self._loops: list[FixedRateLoop] = []
        self._nodes: list[Node] = [self.client]
        self._action_clients: list[ActionClient] = []
        self.every: list[Callable[[], None]] = []  # called once per turn

    def add(self, kind: Callable[..., Any], **parameters: Any) -> Any:
        """A node of this kind with these parameters ('__' for '.')."""
        given = [Parameter(name.replace("__", "."), value=value) for name, value in parameters.items()]
        node = kind(context=self.context, parameter_overrides=given)
        self._nodes.append(node)
        self._loops.append(node.loop)
        return node

    def turn(self) -> None:
        """One period of everything."""
        for call in self.every:
            call()
        for loop in self._loops:
            loop.once()
        for _ in range(3):
            self._executor.spin_once(timeout_sec=0.0)
        time.sleep(0.002)

    def until(self, condition: Callable[[], Any], patience: float = 30.0) -> bool:
        """Turn until the condition holds; whether it did within `patience` [s]."""
        deadline = time.monotonic() + patience
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.turn()
        return True

    def spin(self, duration: float) -> None:
        """Turn for a while."""
        self.until(lambda: False, duration)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """A service's response."""
        client = self.client.create_client(kind, name)
        assert self.until(client.service_is_ready), f"no service {name}"
        future = client.call_async(request)
        assert self.until(future.done), f"no answer of {name}"
        return future.result()

    def send_goal(self, kind: Any, name: str, goal: Any) -> Any:
        """An accepted goal's handle."""
        client = ActionClient(self.client, kind, name)
        self._action_clients.append(client)
        assert self.until(client.server_is_ready), f"no action {name}"
        future = client.send_goal_async(goal)
        assert self.until(future.done), f"no answer of {name}"
        return future.result()

    def result(self, handle: Any, patience: float = 60.0) -> Any:
        """A goal's response with status and result."""
        future = handle.get_result_async()
        assert self.until(future.done, patience), "the goal did not end"
        return future.result()

    def destroy_action_clients(self) -> None:
        """As when whoever sent the goals is gone."""
        while self._action_clients:
            self._action_clients.pop().destroy()

    def close(self) -> None:
        """Destroy the nodes and the context."""
        self._executor.shutdown()  # it holds what it looked at last, which would stay in the graph
        self.destroy_action_clients()
        for node in self._nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)
