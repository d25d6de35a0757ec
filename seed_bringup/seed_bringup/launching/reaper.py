# SPDX-License-Identifier: Apache-2.0
"""Ends the nodes when the launcher itself is gone, however it died: its pipe to us closes.

Run as a script with `python -I -S`, so that it starts fast and needs nothing installed. Lines on standard input:
`+PGID` a process group to watch over, `-PGID` one that has ended. End of input: interrupt, terminate, kill.
"""

import contextlib
import os
import signal
import sys
import time


def end(groups: set[int]) -> None:
    """SIGINT; SIGTERM to what is left after 1.5 s, SIGKILL after 3 s."""
    for number, patience in ((signal.SIGINT, 1.5), (signal.SIGTERM, 1.5), (signal.SIGKILL, 0.0)):
        groups = {group for group in groups if signalled(group, number)}
        deadline = time.monotonic() + patience
        while groups and time.monotonic() < deadline:
            time.sleep(0.05)
            groups = {group for group in groups if signalled(group, 0)}


def signalled(group: int, number: int) -> bool:
    """Send to a process group (0: only look for it); False when it is gone."""
    try:
        os.killpg(group, number)
    except (ProcessLookupError, PermissionError):
        return False
    return True


def main() -> None:
    """Follow the launcher until its pipe closes."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    for line in sys.stdin:
        with contextlib.suppress(ValueError):
            group = int(line[1:])
            (groups.add if line[0] == "+" else groups.discard)(group)
    end(groups)


if __name__ == "__main__":
    main()
