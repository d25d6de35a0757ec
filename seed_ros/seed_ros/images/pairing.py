# SPDX-License-Identifier: Apache-2.0
"""Approximate time synchronisation of several streams: real pairs by stamp, never the latest of each."""

import math
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")

BACKWARDS = 0.5  # [s] a stamp this much older than its predecessor is a clock that was set back, not a late packet


class Pairing(Generic[T]):
    """Collects one item of each stream whose stamps lie within `tolerance` [s].

    Queues are bounded: the oldest item is dropped and counted. A clock that jumps back empties the queues.
    """

    def __init__(self, streams: tuple[str, ...], tolerance: float, depth: int = 4) -> None:
        self.tolerance = tolerance
        self._queues: dict[str, deque[tuple[float, T]]] = {name: deque() for name in streams}
        self._depth = depth
        self._newest: dict[str, float] = dict.fromkeys(streams, -math.inf)
        self.complete = 0
        self.skew = 0.0  # [s] between the oldest and the newest stamp of the last set
        self.unpaired = 0
        self.backwards = 0

    def add(self, stream: str, stamp: float, item: T) -> tuple[float, dict[str, T]] | None:
        """(oldest stamp [s], items by stream) when this item completes a set, else None."""
        if not self._in_order(stream, stamp):
            return None
        queue = self._queues[stream]
        queue.append((stamp, item))
        if len(queue) > self._depth:
            queue.popleft()
            self.unpaired += 1
        return self._match()

    def clear(self) -> None:
        """Forget what waits."""
        for queue in self._queues.values():
            queue.clear()

    def _in_order(self, stream: str, stamp: float) -> bool:
        """Whether to use the stamp: repeated and late ones are left out, after a jump everything starts again."""
        newest = self._newest[stream]
        if stamp > newest:
            self._newest[stream] = stamp
            return True
        self.backwards += 1
        if newest - stamp > BACKWARDS:
            self.clear()
            self._newest = dict.fromkeys(self._newest, -math.inf)
            self._newest[stream] = stamp
            return True
        return False

    def _match(self) -> tuple[float, dict[str, T]] | None:
        """Drop what can have no partner any more: an item older than the newest head by more than the tolerance."""
        while all(self._queues.values()):
            heads = {name: queue[0][0] for name, queue in self._queues.items()}
            oldest = min(heads, key=lambda name: heads[name])
            skew = max(heads.values()) - heads[oldest]
            if skew <= self.tolerance:
                self.complete, self.skew = self.complete + 1, skew
                return heads[oldest], {name: queue.popleft()[1] for name, queue in self._queues.items()}
            self._queues[oldest].popleft()
            self.unpaired += 1
        return None
