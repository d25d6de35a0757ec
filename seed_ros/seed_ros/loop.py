# SPDX-License-Identifier: Apache-2.0
"""A fixed-rate loop with absolute deadlines, for nodes that control or simulate.

An rclpy executor builds its wait set anew for every message; at 250 Hz in and out that alone is a third of a core. Here
the streams that matter are polled once per period, without an executor, and the rest (services, actions, slow
timers) is spun a few times between.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import (
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.node import Node
from rclpy.timer import Timer

from seed_ros.qos import QoSProfile

PERIODS = 2500  # of the last ten seconds, for percentiles
LATE = 5  # [periods] behind which deadlines start anew: what was missed is not made up for
IDLE_REST = 0.1  # [s] between two looks at services, actions and slow timers
BUSY_REST = 0.02  # [s] while they are in use: for BUSY after the last call
BUSY = 0.5  # [s]
CALLBACKS = 4  # of these per look
MOST = 50  # messages taken from one stream per period

QUIET_OUT = PublisherEventCallbacks(use_default_callbacks=False)  # each event handler is one more thing to wait for
QUIET_IN = SubscriptionEventCallbacks(use_default_callbacks=False)


class _Polled(CallbackGroup):
    """Of subscriptions that the executor leaves alone."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


class RestExecutor(SingleThreadedExecutor):
    """Tells whether there was something to do, so that an idle look costs one wait set and no more."""

    def run_some(self) -> bool:
        """Run the callbacks that are ready now, a few at most; whether one was more than a timer's."""
        called = False
        for _ in range(CALLBACKS):
            entity = self._run_one()
            if entity is None:
                break
            called |= not isinstance(entity, Timer)
        return called

    def _run_one(self) -> Any:
        """What was served, or None."""
        try:
            handler, entity, _ = self.wait_for_ready_callbacks(timeout_sec=0.0)
        except (TimeoutException, ShutdownException, ExternalShutdownException):
            return None
        handler()
        error = handler.exception()
        if error is not None:
            raise error
        return entity or self


class FixedRateLoop:
    """`poll` subscriptions, then `run`."""

    def __init__(self, node: Node, rate: float, tick: Callable[[], None]) -> None:
        self.node, self.period, self._tick = node, 1.0 / rate, tick
        self.periods: deque[float] = deque(maxlen=PERIODS)  # [s]
        self.overruns = 0
        self._group = _Polled()
        self._polled: list[tuple[Any, Callable[[Any, Any], None]]] = []

    def poll(self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile) -> None:
        """As create_subscription; the callback runs at the beginning of a period."""
        self._poll(kind, topic, lambda message, _: callback(message), qos, raw=False)

    def poll_raw(self, kind: Any, topic: str, callback: Callable[[bytes, Any], None], qos: QoSProfile) -> None:
        """As `poll`; the callback gets the serialized message and what is known of it (MessageInfo as a dict)."""
        self._poll(kind, topic, callback, qos, raw=True)

    def _poll(self, kind: Any, topic: str, callback: Callable[[Any, Any], None], qos: QoSProfile, raw: bool) -> None:
        subscription = self.node.create_subscription(
            kind, topic, callback, qos, callback_group=self._group, event_callbacks=QUIET_IN, raw=raw
        )
        self._polled.append((subscription, callback))

    def run(self, ended: Callable[[], bool] = lambda: False) -> None:
        """Until the context ends, or `ended()`."""
        executor = self.executor()
        next_rest, busy_until, deadline, last = 0.0, 0.0, time.monotonic(), time.monotonic()
        while self.node.context.ok() and not ended():
            self.take()
            self._tick()
            now = time.monotonic()
            self.periods.append(now - last)
            last = now
            if now >= next_rest:
                if executor.run_some():
                    busy_until = now + BUSY
                next_rest = now + (BUSY_REST if now < busy_until else IDLE_REST)
            deadline = self._wait(deadline + self.period)

    def executor(self) -> RestExecutor:
        """Of everything but the polled streams."""
        executor = RestExecutor(context=self.node.context)
        executor.add_node(self.node)
        return executor

    def once(self, executor: RestExecutor) -> None:
        """One period without its waiting, for callers with a loop of their own."""
        self.take()
        self._tick()
        executor.run_some()

    def take(self) -> None:
        """Give every polled message that has come to its callback."""
        for subscription, callback in self._polled:
            with subscription.handle:
                for _ in range(MOST):
                    taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                    if taken is None:
                        break
                    callback(*taken)

    def _wait(self, deadline: float) -> float:
        remaining = deadline - time.monotonic()
        if remaining > 0.0:
            time.sleep(remaining)
            return deadline
        self.overruns += 1
        return deadline if -remaining < LATE * self.period else time.monotonic()
