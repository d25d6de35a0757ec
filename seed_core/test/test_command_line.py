# SPDX-License-Identifier: Apache-2.0
"""Arguments are checked where they are read, results have one place, and JSON stays JSON."""

import argparse
import errno
import json
import os
import signal
from pathlib import Path

import pytest

from seed_core.errors import FailedError, SeedError
from seed_core.program.command_line import Parser, command, interrupts, number, results_folder, seed_number, to_json
from seed_core.program.suggestions import did_you_mean, no_such_file


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
        (KeyboardInterrupt("the tool is lifted"), 130, "seed wipe: interrupted; the tool is lifted\n"),
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
    parser = Parser()
    parser.add_argument("--seed", default=7, help="draws")
    parser.add_argument("--out", default=None, help="folder")
    parser.add_argument("--json", action="store_true", help="one object")
    parser.add_argument("--first", type=int, default=0, help="number")
    text = parser.format_help()
    assert "draws (default: 7)" in text
    assert "number (default: 0)" in text
    assert text.count("default") == 2


def test_results_go_to_the_folder_that_one_stands_in_and_within_the_checkout_to_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkout, mine = tmp_path / "check out", tmp_path / "mine"
    (checkout / "docs").mkdir(parents=True)
    mine.mkdir()
    monkeypatch.setenv("SEED_ROOT", str(checkout))
    for folder, results in ((checkout, checkout), (checkout / "docs", checkout), (mine, mine)):
        monkeypatch.chdir(folder)
        assert results_folder().resolve() == results / "results"
    monkeypatch.delenv("SEED_ROOT")
    assert results_folder().resolve() == mine / "results"


def test_what_a_mistyped_name_was_meant_for_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert did_you_mean("evalaute", ("evaluate", "validate")) == "; did you mean evaluate?"
    assert did_you_mean("zzz", ("evaluate", "validate")) == ""
    (tmp_path / "triangle.yaml").touch()
    (tmp_path / "triangle.txt").touch()
    assert no_such_file(tmp_path / "triangel.yaml") == f"no such file in {tmp_path}; there is triangle.yaml"
    assert no_such_file(tmp_path / "wipe.yaml") == f"no such file in {tmp_path}"
    os.mkfifo(tmp_path / "pipe.yaml")
    assert no_such_file(tmp_path / "pipe.yaml") == f"{tmp_path / 'pipe.yaml'} is a pipe or a device, not a file"
    assert no_such_file(tmp_path) == f"{tmp_path} is a folder, not a file"
    assert no_such_file(tmp_path / "gone" / "wipe.yaml") == f"there is no folder {tmp_path / 'gone'}"
    parser = Parser(prog="seed wipe")
    parser.add_argument("--law", choices=("seed", "plain"))
    with pytest.raises(SystemExit):
        parser.parse_args(["--law", "sed"])
    assert "did you mean seed?; seed wipe --help" in capsys.readouterr().err


def test_a_hang_up_waits_to_be_asked_for_and_under_nohup_is_ignored() -> None:
    before = signal.getsignal(signal.SIGHUP)
    try:
        with interrupts() as check:
            signal.raise_signal(signal.SIGHUP)
            with pytest.raises(KeyboardInterrupt):
                check()
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with interrupts() as check:
            signal.raise_signal(signal.SIGHUP)
            check()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_what_is_not_finite_becomes_null() -> None:
    text = to_json({"a": float("nan"), "b": [1.5, float("-inf")], "c": (2, "x")})
    assert json.loads(text) == {"a": None, "b": [1.5, None], "c": [2, "x"]}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--sede 3", "seed wipe: there is no option --sede; did you mean --seed?; seed wipe --help tells more\n"),
        ("--nonsense", "seed wipe: there is no option --nonsense; seed wipe --help tells more\n"),
        ("", "seed wipe: the following arguments are required: task; seed wipe --help tells more\n"),
        ("a --seed x", "seed wipe: argument --seed: invalid int value: 'x'; seed wipe --help tells more\n"),
        ("a b", "seed wipe: unrecognized arguments: b; seed wipe --help tells more\n"),
    ],
)
def test_a_mistaken_argument_is_told_in_one_line(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = Parser(prog="seed wipe")
    parser.add_argument("task")
    parser.add_argument("--seed", type=int)
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(words.split())
    assert ended.value.code == 2
    assert capsys.readouterr().err == said


def test_a_subcommand_reads_its_own_options(capsys: pytest.CaptureFixture[str]) -> None:
    parser = Parser(prog="seed bag")
    play = parser.add_subparsers(required=True, metavar="play").add_parser("play")
    play.add_argument("--rate", type=float)
    play.add_argument("rest", nargs="*")
    assert parser.parse_args(["play", "--ra", "2"]).rate == 2.0  # shortened, as argparse has it
    assert parser.parse_args(["play", "--rate=2", "--", "--anything"]).rest == ["--anything"]
    with pytest.raises(SystemExit):
        parser.parse_args(["play", "--rat", "2", "--loop"])
    assert capsys.readouterr().err.startswith("seed bag play: there is no option --loop")
