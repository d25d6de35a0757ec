# SPDX-License-Identifier: Apache-2.0
"""Start a stand-in in its own process and talk to its side port, from tests, benchmarks and user scripts."""

from __future__ import annotations

import ctypes
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import time
from typing import Any

from seed_core.errors import FailedError
from seed_ur.standin.options import SIDE_PORT

_numbers = itertools.count()


def private_host() -> str:
    """A loopback address that no other process is likely to use: 127.a.b.c from this process and a counter."""
    seed = os.getpid() * 16 + next(_numbers)
    return f"127.{20 + seed // 62500 % 200}.{seed // 250 % 250}.{2 + seed % 250}"


def _end_with_parent() -> None:
    """Have the kernel end this process when its parent is gone, however that ended."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


def request(host: str, do: str, **arguments: Any) -> dict[str, Any]:
    """One request to the side port of a stand-in; its reply as it comes. Raises OSError when nobody is there."""
    with socket.create_connection((host, SIDE_PORT), timeout=10.0) as connection:
        connection.sendall(json.dumps({"do": do, **arguments}).encode() + b"\n")
        if do == "kill":
            return {"ok": True}
        with connection.makefile("rb") as file:
            reply: dict[str, Any] = json.loads(file.readline() or b'{"ok": false, "error": "closed"}')
    return reply


class StandIn:
    """A running stand-in; a context manager that leaves no process behind."""

    def __init__(self, host: str | None = None, *arguments: str) -> None:
        self.host, self.arguments = host or private_host(), arguments
        self.process: subprocess.Popen[bytes] | None = None
        self.start()

    def __enter__(self) -> StandIn:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Start (again) and wait until it serves."""
        command = [sys.executable, "-m", "seed_ur.ur_sim", "--host", self.host, *self.arguments]
        self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=_end_with_parent)
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and self.process.poll() is None:
            try:
                self.ask("state")
                return
            except OSError:
                time.sleep(0.02)
        self.close()
        raise FailedError(f"the stand-in controller did not start on {self.host}")

    def ask(self, do: str, **arguments: Any) -> dict[str, Any]:
        """One request to the side port; raises SeedError when it is refused."""
        reply = request(self.host, do, **arguments)
        if not reply.pop("ok"):
            raise FailedError(f"stand-in refused {do}: {reply['error']}")
        return reply

    def kill(self) -> None:
        """End the process at once, as a power failure would."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def close(self) -> None:
        """End the process."""
        self.kill()
        self.process = None
