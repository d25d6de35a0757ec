# SPDX-License-Identifier: Apache-2.0
"""Python processes beside a benchmark: those that keep cores busy, and those that feed a node."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

BUSY = ("-c", "while True: sum(range(10000))")  # one core


@contextmanager
def processes(*commands: Sequence[str]) -> Iterator[None]:
    """Run Python with these arguments, a process each, until the block ends."""
    with ExitStack() as stack:
        for arguments in commands:
            command = [sys.executable, *arguments]
            process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.DEVNULL))
            stack.callback(process.terminate)
        yield
