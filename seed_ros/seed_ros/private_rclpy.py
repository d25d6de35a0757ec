# SPDX-License-Identifier: Apache-2.0
"""The private names of rclpy that the suite uses. They stand in this file alone, and each may be missing.

| private | why | without it |
|---|---|---|
| `Subscription.handle.take_message` | takes a message without an executor, whose wait set is built anew for each: \
a third of a core at 250 Hz in and out | the executor takes them |
| `rclpy_implementation.WaitSet` | sleeps until one of the polled streams has a message | a look every 2 ms |
| `Node._parameter_overrides` | names of the parameters given from outside, also those that nobody declares | \
unknown names are not refused |
"""

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rclpy.context import Context
from rclpy.node import Node
from rclpy.subscription import Subscription

try:
    from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
except ImportError:
    _rclpy = None


def can_poll(rclpy_implementation: Any = _rclpy) -> bool:
    """Whether `take` and `wait_for` work with this rclpy."""
    taking = getattr(getattr(rclpy_implementation, "Subscription", None), "take_message", None)
    return taking is not None and hasattr(rclpy_implementation, "WaitSet")


def take(subscription: Subscription, most: int) -> Iterator[tuple[Any, Any]]:
    """Messages of a subscription that have come, and what is known of each (MessageInfo as a dict)."""
    with subscription.handle:
        for _ in range(most):
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                return
            yield taken


def wait_for(context: Context, subscriptions: Sequence[Subscription], within: float) -> list[Subscription]:
    """Those of the subscriptions with messages, as soon as there is one, or after `within` [s]."""
    handles = [subscription.handle for subscription in subscriptions]
    with contextlib.ExitStack() as stack:
        for handle in (context.handle, *handles):
            stack.enter_context(handle)
        wait_set = _rclpy.WaitSet(len(handles), 0, 0, 0, 0, 0, context.handle)
        wait_set.clear_entities()
        for handle in handles:
            wait_set.add_subscription(handle)
        wait_set.wait(max(int(within * 1e9), 0))
        return [s for i, s in enumerate(subscriptions) if wait_set.is_ready("subscription", i)]


def given_parameters(node: Node) -> Iterable[str]:
    """Names of the parameters given to a node by files, command line or constructor; empty where that is not told."""
    return tuple(getattr(node, "_parameter_overrides", ()))
