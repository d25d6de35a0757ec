# SPDX-License-Identifier: Apache-2.0
"""A recording in a process of its own, so that it does not disturb who starts it.

with Recording(folder / "bag.mcap", ["/relative_pose", "/tf"]):
    ...
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO

from seed_bringup.bags.types import BagError

CLOSE_PATIENCE = 30.0  # [s] to write the last chunk and the index


class Recording:
    """Records topics (all when none is named) to a bag until stop()."""

    def __init__(self, path: str | Path, topics: Sequence[str] = (), sim_time: bool = False) -> None:
        self.path = Path(path)
        self._what = [*topics] if topics else ["--all"]
        self._what += ["--use-sim-time"] if sim_time else []
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] | None = None

    def start(self) -> Recording:
        """Start the recorder; topics that appear later are recorded from their first match on."""
        command = [sys.executable, "-P", "-m", "seed_bringup.commands.bag", "record", "-o", str(self.path), *self._what]
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  (read again after the process has ended)
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT, start_new_session=True
        )
        return self

    def stop(self) -> Path:
        """End the recording and return the finished bag; BagError with the recorder's words when there is none."""
        if self._process is None:
            raise BagError(f"{self.path}: the recording was not started")
        self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(timeout=CLOSE_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        words = self.output()
        if code != 0 or not self.path.exists():
            raise BagError(f"recording {self.path} failed with exit code {code}:\n{words}")
        return self.path

    def output(self) -> str:
        """What the recorder has said so far."""
        if self._log is None:
            return ""
        self._log.seek(0)
        return self._log.read().decode(errors="replace")

    def __enter__(self) -> Recording:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.stop()
        except BagError:
            if error is None:
                raise  # else whatever ended the block tells more than a recorder that had hardly begun
