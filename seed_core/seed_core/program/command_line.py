# SPDX-License-Identifier: Apache-2.0
"""The base of the suite's command lines: checked arguments, help, exit codes, and the folder of results."""

import argparse
import errno
import functools
import itertools
import json
import math
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TypeVar

from seed_core.errors import FailedError, SeedError, os_error_words
from seed_core.program.suggestions import did_you_mean

N = TypeVar("N", int, float)
FULL = (errno.ENOSPC, errno.EDQUOT)  # a disk, or what a user may have of it: no mistake in a command
LARGEST_SEED = 2**31 - 1  # what a parameter of a node takes, too


class Help(argparse.HelpFormatter):
    """Lines as they are written; a default is named where it tells something that the help does not."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=100)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        del width
        return "".join(indent + line for line in text.splitlines(keepends=True))

    def _get_help_string(self, action: argparse.Action) -> str:
        text = action.help or ""
        nothing = action.default is None or action.default is False or action.default in ("", [], argparse.SUPPRESS)
        told = nothing or "default" in text or not action.option_strings
        return text if told else f"{text} (default: %(default)s)".lstrip()


class Parser(argparse.ArgumentParser):
    """A command's arguments: help as it is written, and mistakes told in one line, an unknown option first."""

    def __init__(self, *, formatter_class: Any = Help, **settings: Any) -> None:
        super().__init__(formatter_class=formatter_class, **settings)

    def error(self, message: str) -> NoReturn:
        """One line, and the exit code of wrong use."""
        self.exit(2, f"{self.prog}: {message}; {self.prog} --help tells more\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As its base, which would name a missing argument and not the misspelt one."""
        given = list(sys.argv[1:] if args is None else args)
        known = [o[2:] for o in self._option_string_actions if o.startswith("--")]
        for option in self._options(given):
            if not any(k.startswith(option) for k in known):
                self.error(f"there is no option --{option}{did_you_mean(option, known, '--')}")
        return super().parse_known_args(given, namespace)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """As its base, with what may have been meant."""
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            error.message += did_you_mean(str(value), map(str, action.choices or ()))
            raise

    def _options(self, given: Sequence[str]) -> list[str]:
        """Names of the long options among the words, up to where a subcommand reads on."""
        words = itertools.takewhile(lambda w: w != "--", given)
        if self._subparsers is not None:
            words = itertools.takewhile(lambda w: w.startswith("-"), words)
        return [w[2:].partition("=")[0] for w in words if w.startswith("--")]


def whole(low: int, high: float = math.inf) -> Callable[[str], int]:
    """Type of an argument: a whole number from `low` to `high`."""
    return _within(int, low, high, "a whole number", "")


def number(low: float, unit: str, high: float = math.inf) -> Callable[[str], float]:
    """Type of an argument: a finite number from `low` to `high`, in `unit`."""
    return _within(float, low, high, "a number", f" {unit}")


def _within(kind: type[N], low: float, high: float, what: str, unit: str) -> Callable[[str], N]:
    bound = f"of at least {low:.10g}{unit}" if math.isinf(high) else f"from {low:.10g} to {high:.10g}{unit}"

    def parse(text: str) -> N:
        try:
            value: N | None = kind(text)
        except ValueError:
            value = None
        if value is None or not (low <= value <= high and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"{text} must be {what} {bound}")
        return value

    return parse


seed_number = whole(0, LARGEST_SEED)


def command(name: str) -> Callable[[Callable[[list[str]], int | None]], Callable[..., int]]:
    """Decorator of a command's main(argv): answers errors in one line that begins with `name`, and gives the exit code.

    0: good (also for None). 1: the result is bad, or something failed on the way. 2: used wrongly, that is an argument
    or a file that it names. 130: Ctrl-C; what its exception says is told. 141: nobody reads the output any more.
    Without argv it takes the process's.
    """

    def decorate(main: Callable[[list[str]], int | None]) -> Callable[..., int]:
        @functools.wraps(main)
        def run(argv: list[str] | None = None) -> int:
            try:
                return main(sys.argv[1:] if argv is None else argv) or 0
            except KeyboardInterrupt as end:
                problem, code = "; ".join(["interrupted", *map(str, end.args)]), 130
            except BrokenPipeError:
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                return 141
            except SeedError as error:
                problem, code = str(error), 1 if isinstance(error, FailedError) else 2
            except OSError as error:  # a folder that cannot be written, a file where a folder should be; a full disk
                problem, code = os_error_words(error), 1 if error.errno in FULL or not error.filename else 2
            print(f"{name}: {problem}", file=sys.stderr)
            return code

        return run

    return decorate


@contextmanager
def leaving_at_once(name: str) -> Iterator[None]:
    """While libraries are imported Ctrl-C ends the process: a KeyboardInterrupt may be swallowed in there."""

    def leave(number: int, frame: FrameType | None) -> None:
        del number, frame
        try:
            print(f"seed {name}: interrupted", file=sys.stderr, flush=True)
        finally:
            os._exit(130)  # also where nobody reads any more

    before = signal.signal(signal.SIGINT, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def interrupts() -> Iterator[Callable[[], None]]:
    """Ctrl-C, a hang-up and a request to end wait until the function that this gives is called, which raises.

    Raised anywhere they would end in the middle of a library, with its traceback. A second one ends the process.
    A hang-up that is ignored, as under nohup, stays so.

    Raises:
        KeyboardInterrupt: by the function.
    """
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        del frame
        if came:
            os._exit(128 + number)
        came.append(number)

    told: list[int] = []

    def check() -> None:
        if came and not told:
            told.append(came[0])
            raise KeyboardInterrupt

    nohup = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    numbers = (signal.SIGINT, signal.SIGTERM, *(() if nohup else (signal.SIGHUP,)))
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def results_folder() -> Path:
    """Where a command leaves its results by itself: results/ of the current folder; within the checkout, of that."""
    root = Path(os.environ.get("SEED_ROOT") or ".").resolve()
    return root / "results" if Path.cwd().is_relative_to(root) else Path("results")


def to_json(value: Any, indent: int | None = None) -> str:
    """JSON, which knows neither NaN nor infinity: null instead."""
    return json.dumps(_finite(value), indent=indent)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
