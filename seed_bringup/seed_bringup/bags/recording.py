# SPDX-License-Identifier: Apache-2.0
"""A recording in a process of its own, so that it does not disturb who starts it."""

import ctypes
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from seed_bringup.bags import BagError

CLOSE_PATIENCE = 30.0  # [s] to write the last chunk and the index


@contextmanager
def recording(path: str | Path, topics: Sequence[str] = (), sim_time: bool = False) -> Iterator[Callable[[], str]]:
    """Records topics to a bag while the block runs; those that appear later as well.

    with recording(folder / "bag.mcap", ["/relative_pose", "/tf"]):
        ...

    Args:
        path: A folder to make, or a single file that ends in .mcap.
        topics: All when none is named.
        sim_time: Whether to stamp by /clock.

    Yields:
        A function that returns what the recorder has said so far.

    Raises:
        BagError: At the end of the block, with the recorder's words, when there is no bag.
    """
    command = [sys.executable, "-P", "-m", "seed_bringup.commands.bag", "record", "-o", str(path)]
    command += [*(topics or ["--all"]), *(["--use-sim-time"] if sim_time else [])]
    with tempfile.TemporaryFile() as log:

        def said() -> str:
            log.seek(0)
            return log.read().decode(errors="replace")

        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )
        try:
            yield said
        finally:  # an error in the block tells more than a recorder that had hardly begun
            process.send_signal(signal.SIGINT)
            try:
                process.wait(timeout=CLOSE_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
        if process.wait() != 0 or not Path(path).exists():
            raise BagError(f"recording {path} failed with exit code {process.returncode}:\n{said()}")


def _end_with_parent() -> None:
    """Have the system interrupt this process, which completes the bag, when its parent ends, killed or not."""
    ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG
