# SPDX-License-Identifier: Apache-2.0
"""Answers of services, sent again until the middleware knows who asked.

A client's request may come before its stream of answers is known here. rmw_fastrtps then waits for 0.1 s and leaves the
answer out, of which rclpy only warns (github.com/ros2/rmw_fastrtps/issues/842): the client would wait for ever.
"""

import warnings
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.service import Service

AGAIN = 0.2  # [s] to the second attempt, twice as long to each further one: in each the node stands still for 0.1 s
ATTEMPTS = 6


def resend_unsent_answers(node: Node, service: Service) -> None:
    """Have the answers of a node's service sent again, for a few seconds, while the client is not known."""
    send_once = service.send_response

    def sent(response: Any, header: Any) -> bool:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            send_once(response, header)
        late = [w for w in told if "failed to send response" in str(w.message)]
        for other in told:
            if other not in late:
                warnings.warn_explicit(other.message, other.category, other.filename, other.lineno)
        return not late

    def send(response: Any, header: Any, attempt: int = 1) -> None:
        if sent(response, header):
            return
        if attempt == ATTEMPTS:
            node.get_logger().warning(f"{service.srv_name}: nobody took the answer")
            return

        def again() -> None:
            node.destroy_timer(timer)
            send(response, header, attempt + 1)

        wait = AGAIN * 2.0 ** (attempt - 1)
        timer = node.create_timer(wait, again, clock=Clock(clock_type=ClockType.STEADY_TIME))

    service.send_response = send
