# SPDX-License-Identifier: Apache-2.0
"""Approximate time synchronisation of several streams: real pairs by stamp, never the latest of each."""

import math
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")

_LONGER, _PAUSE = 1.6, 20.0  # of the usual time between two sets: one is missing; a pause of the whole stream
_SMOOTH, _GROWS = 0.1, 1.02  # of the usual time, by each set; by each longer gap, as a stream may become slower
_SLOWER = 1.05  # per item, by which a period may seem to grow: a lost item doubles one
BACKWARDS = 0.5  # [s] a stamp this much older than its predecessor is a clock that was set back, not a late packet


class Pairing(Generic[T]):
    """Collects one item of each stream whose stamps lie within `tolerance` [s].

    The nearest make a set, also where the tolerance is wider than the time between two items: a skew beyond half of
    that waits for the next item of the late stream, which may be nearer. Queues are bounded: the oldest item is dropped
    and counted. A clock that jumps back empties the queues.
    """

    def __init__(self, streams: tuple[str, ...], tolerance: float, depth: int = 4) -> None:
        self.tolerance = tolerance
        self._queues: dict[str, deque[tuple[float, T]]] = {name: deque() for name in streams}
        self._depth = depth
        self._newest: dict[str, float] = dict.fromkeys(streams, -math.inf)
        self._period: dict[str, float] = dict.fromkeys(streams, math.inf)  # [s] between items, where none is lost
        self.complete = 0
        self.skew = 0.0  # [s] between the oldest and the newest stamp of the last set
        self.unpaired = 0
        self.backwards = 0
        self.missing = 0  # sets that the gaps between complete ones tell of, whatever became of them
        self._usual, self._done = 0.0, math.inf  # [s] between two sets; stamp of the newest

    def add(self, stream: str, stamp: float, item: T) -> tuple[float, dict[str, T]] | None:
        """(oldest stamp [s], items by stream) when this item completes a set, else None."""
        if not self._in_order(stream, stamp):
            return None
        queue = self._queues[stream]
        queue.append((stamp, item))
        if len(queue) > self._depth:
            queue.popleft()
            self.unpaired += 1
        done = self._match()
        if done is not None:
            self._look_for_gap(done[0])
        return done

    def _look_for_gap(self, stamp: float) -> None:
        """Count what is missing between the last complete set and this one."""
        gap, self._done = stamp - self._done, stamp
        if gap <= 0.0:
            return
        if not self._usual:
            self._usual = gap
        elif gap < _LONGER * self._usual:
            self._usual += _SMOOTH * (gap - self._usual)
        elif gap < _PAUSE * self._usual:
            self.missing += round(gap / self._usual) - 1
            self._usual *= _GROWS

    def clear(self) -> None:
        """Forget what waits."""
        for queue in self._queues.values():
            queue.clear()

    def _in_order(self, stream: str, stamp: float) -> bool:
        """Whether to use the stamp: repeated and late ones are left out, after a jump everything starts again."""
        newest = self._newest[stream]
        if stamp > newest:
            self._newest[stream] = stamp
            self._period[stream] = min(stamp - newest, _SLOWER * self._period[stream])
            return True
        self.backwards += 1
        if newest - stamp > BACKWARDS:
            self.clear()
            self._newest = dict.fromkeys(self._newest, -math.inf)
            self._newest[stream] = stamp
            return True
        return False

    def _match(self) -> tuple[float, dict[str, T]] | None:
        """The newest set that is complete. What can have no partner any more is dropped, and what has a nearer one."""
        done: tuple[float, dict[str, T]] | None = None
        while all(self._queues.values()):
            heads = {name: queue[0][0] for name, queue in self._queues.items()}
            oldest = min(heads, key=lambda name: heads[name])
            queue, skew = self._queues[oldest], max(heads.values()) - heads[oldest]
            if len(queue) > 1:
                after = [*(heads[name] for name in heads if name != oldest), queue[1][0]]
                fits = skew <= max(after) - min(after)
            else:
                fits = True
                if 0.5 * self._period[oldest] < skew <= self.tolerance:
                    break
            if skew <= self.tolerance and fits:
                self.unpaired += len(heads) if done is not None else 0
                self.complete, self.skew = self.complete + (done is None), skew
                done = heads[oldest], {name: queue.popleft()[1] for name, queue in self._queues.items()}
                continue
            queue.popleft()
            self.unpaired += 1
        return done
