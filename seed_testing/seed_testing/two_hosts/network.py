# SPDX-License-Identifier: Apache-2.0
"""Two network namespaces and the link between them: delay, jitter, loss, a cut.

Each namespace has one TUN interface, whose packets this process hands to the other one. That needs no traffic control
in the kernel; it needs the rights of root.
"""

import fcntl
import heapq
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from seed_core.errors import FailedError

TUN, SET_INTERFACE, NO_HEADER, IS_TUN = Path("/dev/net/tun"), 0x400454CA, 0x1000, 0x0001  # linux/if_tun.h
ADDRESSES = ("10.77.0.1", "10.77.0.2")
MOST = 2000  # [bytes] of a packet


class Quality(NamedTuple):
    """Of a link: delay of each way and its standard deviation [s], share of packets that are lost; cut: all of them."""

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    cut: bool = False


class Way:
    """One direction: packets go in at a time and come out in order, late, or not at all."""

    def __init__(self, seed: int) -> None:
        self._rng, self._due = random.Random(seed), 0.0
        self._queue: list[tuple[float, int, bytes]] = []
        self._count = 0
        self.lost = 0

    def put(self, packet: bytes, now: float, quality: Quality) -> None:
        """A packet that comes at now [s]."""
        if quality.cut or self._rng.random() < quality.loss:
            self.lost += 1
            return
        late = max(self._rng.gauss(quality.delay, quality.jitter), 0.0)
        self._due = max(self._due, now + late)  # a queue keeps the order
        self._count += 1
        heapq.heappush(self._queue, (self._due, self._count, packet))

    def take(self, now: float) -> list[bytes]:
        """The packets that are due at now [s]."""
        out = []
        while self._queue and self._queue[0][0] <= now:
            out.append(heapq.heappop(self._queue)[2])
        return out

    @property
    def next(self) -> float:
        """When the next one is due [s]; inf: none is on its way."""
        return self._queue[0][0] if self._queue else float("inf")


def why_not() -> str:
    """Why this machine cannot do it; '' if it can."""
    if os.geteuid() != 0:
        return "two network namespaces need the rights of root: run it with sudo, or as root of a virtual machine"
    if shutil.which("ip") is None:
        return "there is no program `ip`: install iproute2"
    return "" if TUN.exists() else f"there is no {TUN}: load the kernel module tun"


class TwoHosts:
    """A context manager: both namespaces and the link between them.

    Attributes:
        names: of the namespaces. quality: of the link, may be changed at any time.
    """

    def __init__(self) -> None:
        """Raises FailedError: this machine does not have what it takes."""
        if why := why_not():
            raise FailedError(why)
        self.names = tuple(f"seed-{which}-{os.getpid()}" for which in ("camera", "robot"))
        self.quality = Quality()
        self._ways = Way(1), Way(2)
        self._ends: list[int] = []
        self._over = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> "TwoHosts":
        with ExitStack() as stack:
            for i, name in enumerate(self.names):
                _ip("netns", "add", name)
                stack.callback(_ip, "netns", "del", name)
                device = f"seed{i}-{os.getpid()}"
                self._ends.append(_tun(device))
                stack.callback(os.close, self._ends[-1])
                _ip("link", "set", device, "netns", name)
                _ip("-n", name, "addr", "add", ADDRESSES[i], "peer", ADDRESSES[1 - i], "dev", device)
                _ip("-n", name, "link", "set", device, "up")
                _ip("-n", name, "link", "set", "lo", "up")
            thread = threading.Thread(target=self._relay, daemon=True)
            thread.start()
            stack.callback(thread.join)
            stack.callback(self._over.set)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def lost(self) -> int:
        """Packets that the link has lost so far, both ways."""
        return sum(way.lost for way in self._ways)

    def inside(self, which: int, command: Sequence[str]) -> list[str]:
        """That command line, in the first or second namespace, with a shared memory of its own."""
        own = 'mount -t tmpfs tmpfs /dev/shm && exec "$@"'
        return ["ip", "netns", "exec", self.names[which], "sh", "-c", own, "sh", *command]

    def _relay(self) -> None:
        poll = select.poll()
        for end in self._ends:
            poll.register(end, select.POLLIN)
        while not self._over.is_set():
            wait = min(min(way.next for way in self._ways) - time.monotonic(), 0.1)
            for end, _ in poll.poll(1e3 * max(wait, 0.0)):
                self._ways[self._ends.index(end)].put(os.read(end, MOST), time.monotonic(), self.quality)
            now = time.monotonic()
            for i, way in enumerate(self._ways):
                for packet in way.take(now):
                    os.write(self._ends[1 - i], packet)


def _tun(name: str) -> int:
    """A TUN interface of that name; the descriptor of its packets."""
    end = os.open(TUN, os.O_RDWR)
    fcntl.ioctl(end, SET_INTERFACE, struct.pack("16sH", name.encode(), IS_TUN | NO_HEADER))
    return end


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise FailedError(f"ip {' '.join(words)}: {done.stderr.strip()}")
