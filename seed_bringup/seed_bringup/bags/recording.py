# SPDX-License-Identifier: Apache-2.0
"""A recording in a process of its own, so that it does not disturb who starts it."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from seed_bringup.bags import BagError

CLOSE_PATIENCE = 30.0  # [s] to write the last chunk and the index


class Recording:
    """Records topics (all when none is named) to a bag while the block runs; those that appear later as well.

    with Recording(folder / "bag.mcap", ["/relative_pose", "/tf"]):
        ...

    Raises:
        BagError: At the end of the block, with the recorder's words, when there is no bag.
    """

    def __init__(self, path: str | Path, topics: Sequence[str] = (), sim_time: bool = False) -> None:
        self.path = Path(path)
        self._arguments = ["-o", str(self.path), *(topics or ["--all"]), *(["--use-sim-time"] if sim_time else [])]

    def output(self) -> str:
        """What the recorder has said so far."""
        self._log.seek(0)
        return self._log.read().decode(errors="replace")

    def __enter__(self) -> Recording:
        command = [sys.executable, "-P", "-m", "seed_bringup.commands.bag", "record", *self._arguments]
        self._log = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT, start_new_session=True
        )
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(timeout=CLOSE_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        # Whatever ended the block by an error tells more than a recorder that had hardly begun.
        if kind is None and (code != 0 or not self.path.exists()):
            raise BagError(f"recording {self.path} failed with exit code {code}:\n{self.output()}")
