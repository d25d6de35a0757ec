# SPDX-License-Identifier: Apache-2.0
"""The environment of LeRobot: made when it is first wanted, beside that of the suite, never part of it."""

import hashlib
import os
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from pathlib import Path

from seed_core.errors import FailedError

MADE = "seed-complete"  # a file in an environment that is complete


def environment(requirements: Path) -> Path:
    """Where the environment of these pins is, made or not."""
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    suite, home = os.environ.get("VIRTUAL_ENV"), os.environ.get("SEED_HOME")
    base = Path(home) if home else Path(suite).parent if suite else Path(cache, "seed-ros2")
    pins = hashlib.sha256(requirements.read_bytes() + sys.version.encode()).hexdigest()[:12]
    return base / f"lerobot-{pins}"


def interpreter(requirements: Path) -> Path | None:
    """Python of that environment; None where it is not made."""
    folder = environment(requirements)
    return folder / "bin/python" if (folder / MADE).is_file() else None


def make(requirements: Path) -> Path:
    """Python of that environment, which is made if it is not there. Raises FailedError."""
    if python := interpreter(requirements):
        return python
    folder = environment(requirements)
    print(f"seed dataset: making the environment of LeRobot in {folder}, once; it takes up to 9 GB", file=sys.stderr)
    venv.create(folder, with_pip=True, clear=True)
    python = folder / "bin/python"
    outside = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
    command = [str(python), "-m", "pip", "install", "--quiet", "-r", str(requirements)]
    if subprocess.run(command, env=outside, stdout=sys.stderr).returncode:
        raise FailedError(
            f"pip could not install {requirements}; its words stand above. Nothing of the suite has changed"
        )
    (folder / MADE).touch()
    return python


def run(python: Path, script: Path, *words: str, check: Callable[[], None] = lambda: None) -> None:
    """Run a script there. Raises FailedError with what it said.

    check: is called meanwhile; where it raises the script is ended.
    """
    outside = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [str(python), str(script), *words],
            env={**outside, "HF_HUB_OFFLINE": "1", "HF_DATASETS_DISABLE_PROGRESS_BARS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=log,
        )
        try:
            while process.poll() is None:
                check()
                time.sleep(0.05)
            check()  # Ctrl-C reaches the script as well
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
        if process.returncode:
            log.seek(0)
            said = log.read().decode(errors="replace")
            raise FailedError(f"LeRobot could not write the dataset:\n{said[-2000:]}")
