# SPDX-License-Identifier: Apache-2.0
"""Every ./seed line of README, CONTRIBUTING and docs is one that the program takes: parsed by it as it stands, not run.

What tutorials show is run in test_documents.py, examples in test_examples.py, what wants a live cell in tests of nodes.
"""

import importlib.util
import re
import runpy
import shlex
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from seed_bringup.command_table import offered
from seed_bringup.commands import dispatch
from seed_bringup.launching.description import declared_arguments
from seed_bringup.launching.packages import find_launch_file

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(not (ROOT / "seed").is_file(), reason="this is an installed copy, not the checkout")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("**/*.md"))]
# A line of a block, indented or fenced, or code within a sentence; up to a comment.
LINE = re.compile(r"(?:^ {4,}|^\$ |^|(`))(\./seed\b[^`\n]*)", re.MULTILINE)
# What stands in a document for the reader's own
OWN = {
    "COMMAND --help": "evaluate --help",
    "--law NAME": "--law seed",
    "--model NAME": "--model hysteretic",
    "validate estimator --method NAME": "validate estimator --method rigid_fit",
    "--method NAME": "--method seed",
    "--scenario NAME": "--scenario box",
    "--scenario TOOL": "--scenario box",
    "--membrane M": "--membrane 1",
    "--seed N": "--seed 1",
    "--seed S": "--seed 1",
}


class TakenError(Exception):
    """The arguments were read without a complaint."""


def commands_of(page: Path) -> Iterator[str]:
    """What stands after ./seed, without comment; with the reader's own filled in."""
    for match in LINE.finditer(page.read_text().replace("\\\n", "")):
        line = match[2].split("  #")[0].split(" # ")[0].split("; echo")[0].strip().removesuffix("&")
        for own, word in OWN.items():
            line = line.replace(own, word)
        yield line.removeprefix("./seed").strip()


def mistaken(words: list[str]) -> str:
    """Why the program does not take them, or ''."""
    name, *rest = words
    if name not in offered(checkout=True):
        return "no such command"
    if not rest:  # named in a sentence
        return ""
    match name:
        case "shell":
            return of_shell(shlex.split(rest[1])) if rest[0] == "-c" else "shell takes -c"
        case "test":
            gone = [w for w in rest if w.startswith("seed_") and not (ROOT / w).exists()]
            return f"no {gone}" if gone else ""
        case "call":
            return "" if is_service(rest[0]) else f"no service {rest[0]}"
        case "launch":
            return of_launch(rest)
        case "lint" | "build":
            return ""
    return of_parser(lambda: dispatch.main(words))


def of_launch(rest: list[str]) -> str:
    """Of a launch file, and the arguments that it declares."""
    files, given = [w for w in rest if ":=" not in w], dict(w.split(":=", 1) for w in rest if ":=" in w)
    declared = {a.name for a in declared_arguments(find_launch_file(files))}
    unknown = set(given) - declared
    return f"no arguments {sorted(unknown)}" if unknown else ""


def of_shell(words: list[str]) -> str:
    """Of a module or a tool of the project that runs in the shell."""
    if words[:2] != ["python", "-m"]:
        return "" if (ROOT / (words[1] if words[0] == "python" else words[0])).is_file() else f"no file {words[0]}"
    name = words[2]
    spec = importlib.util.find_spec(f"{name}.__main__") if is_package(name) else importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    if "parse_args(" not in Path(spec.origin).read_text():  # a small one without options
        return ""
    sys.argv = [words[2], *words[3:]]
    return of_parser(lambda: runpy.run_module(words[2], run_name="__main__", alter_sys=True))


def is_package(name: str) -> bool:
    """Whether a module's name is a folder's."""
    spec = importlib.util.find_spec(name)
    return spec is not None and bool(spec.submodule_search_locations)


def of_parser(run: Any) -> str:
    """What its argument parser says."""
    try:
        run()
    except TakenError:
        return ""
    except SystemExit as ended:
        return f"refused: {ended.code}" if ended.code else ""  # 0: it was asked for help
    return "its arguments were never read"


def is_service(name: str) -> bool:
    """Whether docs/interfaces.md has it, which a test compares with the nodes."""
    node, _, service = name.partition("/")
    sections = (ROOT / "docs/interfaces.md").read_text().split("\n## ")
    return any(s.split()[0].rstrip(",") == node and f"| service | `~/{service}`" in s for s in sections)


@pytest.fixture
def _parsed_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command ends once its arguments are read."""
    parse = ArgumentParser.parse_args

    def taken(self: ArgumentParser, *args: Any, **kwargs: Any) -> None:
        parse(self, *args, **kwargs)
        raise TakenError

    monkeypatch.setattr(ArgumentParser, "parse_args", taken)
    monkeypatch.setattr(sys, "argv", sys.argv)
    monkeypatch.chdir(ROOT)


@pytest.mark.usefixtures("_parsed_only")
@pytest.mark.parametrize(
    "line",
    [
        "evaluat squeegee",
        "evaluate squeegee --scenarois 3",
        "call sim/grab",
        "launch cell robott:=sim",
        "test seed_core/test/test_gone.py",
        "shell -c 'python -m seed_testing.camera_contract --brightnis color'",
    ],
)
def test_a_line_that_a_document_should_not_have_is_found(line: str) -> None:
    assert mistaken(shlex.split(line))


@pytest.mark.usefixtures("_parsed_only")
@pytest.mark.parametrize("page", [p for p in PAGES if any(commands_of(p))], ids=lambda p: p.stem)
def test_every_command_of_a_page_is_taken(page: Path) -> None:
    wrong = {line: mistaken(shlex.split(line)) for line in commands_of(page) if line}
    assert not {line: why for line, why in wrong.items() if why}
