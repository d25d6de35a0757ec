# SPDX-License-Identifier: Apache-2.0
"""Long commands with a progress line, a log, and an error that shows its end."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path


class SetupError(Exception):
    """Set-up cannot go on; the message says why and what to do."""

    exit_code = 1


class UsageError(SetupError):
    """An argument or a variable of the environment asks for what cannot be."""

    exit_code = 2


def say(text: str) -> None:
    """One line to the user, apart from what the command itself prints."""
    print(f"seed: {text}", file=sys.stderr, flush=True)


def run_logged(
    command: list[str], what: str, log: Path, env: dict[str, str], shorten: Callable[[str], str], lock: int
) -> None:
    """Run a command with its output in `log` and a line of progress; SetupError when it fails.

    `shorten` turns a line of output into a progress text ('' for none). The command keeps the descriptor `lock` too,
    so that an orphan of a killed set-up still holds the lock; it runs in a session of its own, so that an interrupt
    reaches it through us, children included.
    """
    say(f"{what} (log: {log})")
    started = shown = time.monotonic()
    with (
        log.open("w") as file,
        subprocess.Popen(
            command,
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            pass_fds=[lock],
            start_new_session=True,
        ) as process,
    ):
        try:
            for line in process.stdout or ():
                file.write(line)
                text = shorten(line.rstrip())
                if text and (sys.stderr.isatty() or time.monotonic() - shown > 5.0):
                    shown = time.monotonic()
                    _show(f"{text} ({shown - started:.0f} s)")
        except BaseException:
            _end(process.pid, process.wait)
            raise
        finally:
            if sys.stderr.isatty():
                print("\r\033[K", end="", file=sys.stderr, flush=True)
    if process.returncode != 0:
        tail = "\n".join(log.read_text(errors="replace").splitlines()[-25:])
        code = process.returncode
        raise SetupError(f"{what}: failed with exit code {code}. Its last lines:\n{tail}\nseed: all of it: {log}")
    say(f"{what}: done in {time.monotonic() - started:.0f} s")


def _end(group: int, wait: Callable[..., int]) -> None:
    """Interrupt a process group; kill it 2 s later."""
    for number in (signal.SIGINT, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, subprocess.TimeoutExpired):
            os.killpg(group, number)
            wait(timeout=2.0)


def _show(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\033[Kseed:   {text[:100]}", end="", file=sys.stderr, flush=True)
    else:
        say(f"  {text}")
