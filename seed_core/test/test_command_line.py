# SPDX-License-Identifier: Apache-2.0
"""Arguments are checked where they are read, results have one place, and JSON stays JSON."""

import argparse
import errno
import json
from pathlib import Path

import pytest

from seed_core.errors import FailedError, SeedError
from seed_core.program.command_line import Help, command, number, results_folder, seed_number, to_json


@pytest.mark.parametrize("text", ["-1", "x", "1.5", "", str(2**31), "99999999999999999999"])
def test_a_seed_is_a_whole_number_that_a_parameter_can_hold(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=f"{text} must be a whole number from 0 to 2147483647"):
        seed_number(text)
    assert seed_number("0") == 0
    assert seed_number("2147483647") == 2147483647


@pytest.mark.parametrize("text", ["-0.1", "nan", "inf", "a"])
def test_a_rate_is_finite_and_not_negative(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=f"{text} must be a number of at least 0 Hz"):
        number(0.0, "Hz")(text)
    assert number(0.0, "Hz")("22.5") == 22.5


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (SeedError("no such task"), 2, "seed wipe: no such task\n"),
        (
            PermissionError(errno.EACCES, "Permission denied", "/root/out"),
            2,
            "seed wipe: /root/out: Permission denied\n",
        ),
        (FailedError("the cell ended"), 1, "seed wipe: the cell ended\n"),
        (OSError(errno.ENOSPC, "No space left on device"), 1, "seed wipe: No space left on device\n"),
        (KeyboardInterrupt(), 130, "seed wipe: interrupted\n"),
    ],
)
def test_a_command_tells_wrong_use_from_failure(
    error: BaseException, code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    @command("seed wipe")
    def main(_: list[str]) -> int:
        raise error

    assert main([]) == code
    assert capsys.readouterr().err == said


def test_a_command_gives_its_result_and_lets_defects_through() -> None:
    assert command("seed wipe")(lambda _: None)([]) == 0
    assert command("seed wipe")(lambda argv: len(argv))(["--force"]) == 1
    with pytest.raises(ZeroDivisionError):
        command("seed wipe")(lambda argv: 1 // len(argv))([])


def test_help_names_a_default_only_where_it_tells_something() -> None:
    parser = argparse.ArgumentParser(formatter_class=Help)
    parser.add_argument("--seed", default=7, help="draws")
    parser.add_argument("--out", default=None, help="folder")
    parser.add_argument("--json", action="store_true", help="one object")
    text = parser.format_help()
    assert "draws (default: 7)" in text
    assert text.count("default") == 1


def test_results_go_to_the_checkout_from_wherever_the_command_was_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEED_ROOT", "/a/check out")
    assert results_folder() == Path("/a/check out/results")
    monkeypatch.delenv("SEED_ROOT")
    assert results_folder() == Path("results")


def test_what_is_not_finite_becomes_null() -> None:
    text = to_json({"a": float("nan"), "b": [1.5, float("-inf")], "c": (2, "x")})
    assert json.loads(text) == {"a": None, "b": [1.5, None], "c": [2, "x"]}
