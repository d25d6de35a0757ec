# SPDX-License-Identifier: Apache-2.0
"""A fixed-rate loop with absolute deadlines, for nodes that control or simulate.

An rclpy executor builds its wait set anew for every message; at 250 Hz in and out that alone is a third of a core. Here
the streams that matter are polled once per period, without an executor, and the rest (services, actions, slow
timers) is spun a few times between. With use_sim_time the periods are those of /clock: where that stands still, so
does the loop.
"""

import contextlib
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from math import inf
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import ROSClock
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import (
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.time import Time
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock

from seed_ros import private_rclpy
from seed_ros.qos import CLOCK

PERIODS = 2500  # of the last ten seconds, for percentiles
CLOCK_LOOK = 0.002  # [s] between two looks at a simulated clock
CLOCK_PATIENCE = 5.0  # [s] of silence before it is said
TURNED_BACK = 1.0  # [s] further than this from being due: the simulated clock was set back
LATE = 5  # [periods] behind which deadlines start anew: what was missed is not made up for
CLOSEST = 0.85  # [periods] from the end of a tick to the next, of a loop that makes up for nothing
SERVICE_PERIOD = 0.1  # [s] between two looks at services, actions and slow timers
BUSY_SERVICE_PERIOD = 0.02  # [s] while they are in use: for BUSY after the last call
BUSY = 0.5  # [s]
CALLBACKS = 4  # of these per look
MOST = 50  # messages taken from one stream per period

QUIET = SubscriptionEventCallbacks(use_default_callbacks=False)  # each event handler is one more thing to wait for


class _Polled(CallbackGroup):
    """Of subscriptions that the executor leaves alone."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


class OthersExecutor(SingleThreadedExecutor):
    """Tells whether there was something to do, so that an idle look costs one wait set and no more."""

    def run_some(self, most: int = CALLBACKS) -> bool:
        """Run the callbacks that are ready now, a few at most; whether one was more than a timer's."""
        called = False
        for _ in range(most):
            try:
                handler, entity, _ = self.wait_for_ready_callbacks(timeout_sec=0.0)
            except (TimeoutException, ShutdownException, ExternalShutdownException):
                break
            handler()
            error = handler.exception()
            if error is not None:
                raise error
            called |= not isinstance(entity, Timer)
        return called


@contextlib.contextmanager
def realtime(priority: int) -> Iterator[None]:
    """This process's threads ahead of all ordinary ones, where the system allows it.

    The middleware's threads are among them: a loop that is on time gets no messages from a thread that does not run.
    Threads and processes that are started meanwhile are ordinary.
    """
    before: dict[int, tuple[int, os.sched_param]] = {}
    for thread in map(int, os.listdir("/proc/self/task")) if priority > 0 else ():
        with contextlib.suppress(OSError):  # it has ended, or ordinary users may not: the diagnostics show periods
            before[thread] = os.sched_getscheduler(thread), os.sched_getparam(thread)
            os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    try:
        yield
    finally:
        for thread, (policy, parameters) in before.items():
            with contextlib.suppress(OSError):
                os.sched_setscheduler(thread, policy, parameters)


class FixedRateLoop:
    """`poll` subscriptions, then `run`."""

    def __init__(
        self,
        node: Node,
        rate: float,
        tick: Callable[[], None],
        *,
        steady: bool = False,
        eager: bool = False,
        priority: int = 0,
        service_period: float = SERVICE_PERIOD,
        catch_up: bool = True,
    ) -> None:
        """A loop at `rate` [Hz].

        Args:
            steady: periods of the machine's own clock even with use_sim_time, for nodes that only wait for messages.
            eager: (and steady) polled messages reach their callbacks when they come, not at the next period.
            priority: SCHED_FIFO priority of the process's threads while it runs, where the system allows it; 0: none.
            service_period: [s] between two looks at services, actions and slow timers while nobody uses them.
            catch_up: make up for a few late periods; not when each tick is a step of an arm, which would take several
                that come at once for one long step.
        """
        self.node, self.period, self._tick = node, 1.0 / rate, tick
        self._eager, self._catch_up = eager, catch_up
        self.periods: deque[float] = deque(maxlen=PERIODS)  # [s] from one beginning to the next
        self.overruns = 0
        self._priority, self._service_period = priority, service_period
        self._next_service = self._busy_until = 0.0
        self._extra = inf
        self._callbacks: dict[Subscription, Callable[[Any, Any], None]] = {}
        self._group = _Polled() if private_rclpy.can_poll() else None  # None: the executor takes these as well
        if self._group is None:
            self._service_period = 0.0
        self._unheard = bool(node.get_parameter("use_sim_time").value)  # of a simulated clock
        self._simulated = self._unheard and not steady
        if self._unheard:
            self.poll(Clock, "/clock", self._on_clock, CLOCK)

    def _on_clock(self, message: Clock) -> None:
        clock = self.node.get_clock()
        assert isinstance(clock, ROSClock)
        clock.set_ros_time_override(Time.from_msg(message.clock))
        self._unheard = False

    def _now(self) -> float:
        """Time that periods are counted in [s]."""
        return self.node.get_clock().now().nanoseconds * 1e-9 if self._simulated else time.monotonic()

    def poll(
        self,
        kind: Any,
        topic: str,
        callback: Callable[..., None],
        qos: QoSProfile,
        *,
        raw: bool = False,
        informed: bool = False,
    ) -> Subscription:
        """As create_subscription; the callback runs at the beginning of a period.

        Raw messages stay serialized. Their callback, or an informed one, gets what is known of each besides
        (MessageInfo as a dict).
        """
        receive = callback if raw or informed else lambda message, _: callback(message)
        subscription = self.node.create_subscription(
            kind, topic, receive, qos, callback_group=self._group, event_callbacks=QUIET, raw=raw
        )
        self._callbacks[subscription] = receive
        return subscription

    def leave(self, subscription: Subscription) -> None:
        """Poll one no more."""
        del self._callbacks[subscription]
        self.node.destroy_subscription(subscription)

    @property
    def streams(self) -> Mapping[Subscription, Callable[[Any, Any], None]]:
        """The polled subscriptions, and the callback of each."""
        return self._callbacks

    def also_at(self, at: float) -> None:
        """A period between the regular ones of a steady loop, at time.monotonic() = at [s]."""
        self._extra = at

    def run(self, ended: Callable[[], bool] = lambda: False) -> None:
        """Until the context ends, or `ended()`."""
        self._await_clock(ended)
        with realtime(self._priority):
            due, last = self._now(), time.monotonic()
            while self.node.context.ok() and not ended():
                if self._await(min(due, self._extra)):
                    now = time.monotonic()
                    self.periods.append(now - last)
                    extra = self._extra < due
                    self._extra = inf if extra else self._extra
                    self.take()
                    self._tick()
                    last, due = now, due if extra else self._next(due)
                self._serve_others()

    def _await_clock(self, ended: Callable[[], bool]) -> None:
        """A simulated clock that is not heard yet shows zero: no deadline could be kept by it."""
        started, warned = time.monotonic(), False
        while self._unheard and self.node.context.ok() and not ended():
            time.sleep(CLOCK_LOOK)
            self._take_clock()
            if not warned and time.monotonic() - started > CLOCK_PATIENCE:
                warned = True
                self.node.get_logger().warning("use_sim_time is set, and nothing comes on /clock: waiting for it")

    def _take_clock(self) -> None:
        self._take(next(iter(self._callbacks)))

    def _await(self, due: float) -> bool:
        """Sleep until `due`, or for one look at the simulated clock; whether it is time."""
        if self._eager:
            self._take_what_comes(due - time.monotonic())
            return time.monotonic() >= due
        if not self._simulated:
            time.sleep(max(due - time.monotonic(), 0.0))
            return True
        if not self._has_come(due):
            time.sleep(CLOCK_LOOK)
            self._take_clock()
        return self._has_come(due)

    def _take_what_comes(self, within: float) -> None:
        """Sleep until a message comes, and take it: an executor would build a wait set of everything each time."""
        if self._group is None:
            time.sleep(min(max(within, 0.0), CLOCK_LOOK))
            self.take()
            return
        for subscription in private_rclpy.wait_for(self.node.context, list(self._callbacks), within):
            self._take(subscription)

    def _has_come(self, due: float) -> bool:
        """By a simulated clock, which may be set back."""
        now = self._now()
        return not now < due < now + TURNED_BACK

    def _next(self, due: float) -> float:
        """When the period after the one that was due then begins."""
        now = self._now()
        late = now - due - self.period
        self.overruns += late > 0.0
        regular = due + self.period if -TURNED_BACK < late < LATE * self.period else now
        return regular if self._catch_up else max(regular, now + CLOSEST * self.period)

    def _serve_others(self) -> None:
        now = time.monotonic()
        if now >= self._next_service:
            if self._executor.run_some():
                self._busy_until = now + BUSY
            busy = BUSY_SERVICE_PERIOD if now < self._busy_until else self._service_period
            self._next_service = now + min(busy, self._service_period)

    @cached_property
    def _executor(self) -> OthersExecutor:
        """Of everything but the polled streams."""
        executor = OthersExecutor(context=self.node.context)
        executor.add_node(self.node)
        return executor

    def once(self) -> None:
        """One period without its waiting, for callers with a loop of their own."""
        self.take()
        self._tick()
        self._executor.run_some()

    def take(self) -> None:
        """Give every polled message that has come to its callback."""
        for subscription in tuple(self._callbacks):
            self._take(subscription)

    def _take(self, subscription: Subscription) -> None:
        if self._group is None:
            self._executor.run_some(MOST)
            return
        for message, information in private_rclpy.take(subscription, MOST):
            self._callbacks[subscription](message, information)
