# SPDX-License-Identifier: Apache-2.0
"""./seed test, lint, shell and build: what developers run inside the environment."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

from seed_core.command_line import command
from seed_core.errors import SeedError

# pytest's exit codes
PYTEST_USAGE, PYTEST_NOTHING_COLLECTED = 4, 5


def checkout() -> Path:
    """The repository that ./seed was started from."""
    root = os.environ.get("SEED_ROOT")
    if not root:
        raise SeedError("this works on a checkout only: start it as ./seed from the repository")
    return Path(root)


TEST_HELP = """\
usage: ./seed test [--pins wheels|apt] [PATH ...] [PYTEST ARGUMENTS]

Every test, or those of the files and folders given, for instance:

  ./seed test seed_control                      one package
  ./seed test seed_core/test/test_bushing.py    one file
  ./seed test seed_sim -k plant -x              what pytest takes (./seed test -- --help lists all of it)

  --pins apt    with NumPy 1.26 and the other versions of Ubuntu 24.04, in an environment of their own
  -n 0          in one process; without it two share the work
Recordings that are no part of the project are looked for in $SEED_DATA; their tests are skipped where it is missing."""


@command("seed test")
def test(argv: list[str]) -> int:
    """Run pytest over every package, or over the paths given; further arguments are pytest's."""
    if _asks_for_help(argv):
        print(TEST_HELP)
        return 0
    root = checkout()
    argv = [a for a in argv if a != "--"]
    missing = _missing_paths(argv, root)
    if missing:
        raise SeedError(f"there is no {', '.join(missing)} in {root}")
    paths = [] if _names_a_path(argv, root) else sorted(str(p.relative_to(root)) for p in root.glob("seed_*/test"))
    words = [sys.executable, "-P", "-m", "pytest", "--durations=15", *_workers(argv), *argv, *paths]
    print(f"seed test: {' '.join(words[3:])}", flush=True)
    code = subprocess.run(words, cwd=root).returncode
    return 2 if code in (PYTEST_USAGE, PYTEST_NOTHING_COLLECTED) else min(code, 1)


def _names_a_path(argv: list[str], root: Path) -> bool:
    return any((root / a.split("::")[0]).exists() for a in argv if not a.startswith("-"))


def _missing_paths(argv: list[str], root: Path) -> list[str]:
    """Arguments that look like paths, follow no option, and name nothing."""
    pairs = zip(argv, ["", *argv], strict=False)
    words = [word for word, before in pairs if not word.startswith("-") and not before.startswith("-")]
    return [w for w in words if (w.startswith("seed_") or "/" in w or "::" in w) and not _names_a_path([w], root)]


def _workers(argv: list[str]) -> list[str]:
    """Two processes, each file in one of them; alone when a debugger or the caller's own -n is wanted."""
    own = any(a in ("--pdb", "-s", "-n", "--collect-only") or a.startswith(("-n", "--numprocesses")) for a in argv)
    return [] if own else ["-n", "2", "--dist", "loadfile"]


def _asks_for_help(argv: list[str]) -> bool:
    return argv[:1] in (["-h"], ["--help"])


@command("seed lint")
def lint(argv: list[str]) -> int:
    """Ruff's rules and format over everything, mypy strict over the cores; --fix mends what ruff can."""
    if argv not in ([], ["--fix"]):
        print("usage: ./seed lint [--fix]\n\n" + (lint.__doc__ or ""))
        return 0 if _asks_for_help(argv) else 2
    root = checkout()
    fix = bool(argv)
    ruff = [sys.executable, "-P", "-m", "ruff"]
    commands = [
        [*ruff, "check", *(["--fix"] if fix else []), "."],
        [*ruff, "format", *([] if fix else ["--check"]), "."],
        [sys.executable, "-P", "-m", "mypy", *map(str, cores(root))],
    ]
    codes = []
    for words in commands:
        print(f"seed lint: {' '.join(words[3:5])}", flush=True)
        codes.append(subprocess.run(words, cwd=root).returncode)
    failed = [" ".join(words[3:5]) for words, code in zip(commands, codes, strict=True) if code]
    print(f"seed lint: {'failed: ' + ', '.join(failed) if failed else 'all is well'}")
    return int(bool(failed))


def cores(root: Path) -> list[Path]:
    """Every module but the edge, relative to the checkout."""
    return [f.relative_to(root) for f in sorted(root.glob("seed_*/seed_*/**/*.py")) if not is_edge(f)]


def is_edge(file: Path) -> bool:
    """Whether a module may know ROS: ros/, bags/, seed_ros, and modules named after a node or a bag."""
    return bool({"ros", "bags", "seed_ros"} & set(file.parts[-4:-1])) or file.stem.split("_")[-1] in ("node", "bag")


@command("seed shell")
def shell(argv: list[str]) -> int:
    """An interactive shell in the environment, or one command: ./seed shell -c 'python tool.py'."""
    if _asks_for_help(argv):
        print(f"usage: ./seed shell [-c COMMAND | ARGUMENTS OF THE SHELL]\n\n{shell.__doc__}")
        return 0
    return _become_a_shell(argv)


def _become_a_shell(argv: list[str]) -> NoReturn:
    program = os.environ.get("SHELL", "/bin/bash")
    if not argv:
        print(
            f"seed shell: {os.environ.get('VIRTUAL_ENV', '')}; leave with exit or Ctrl-D",
            file=sys.stderr,
            flush=True,
        )
    os.execvp(program, [program, *argv])


def build(argv: list[str]) -> int:
    """The bootstrap has built the workspace (arguments went to CMake); say so."""
    if _asks_for_help(argv):
        print("usage: ./seed build [CMAKE ARGUMENTS]\n\nBuild every package again; a start does so where it must.")
        return 0
    print("seed build: the workspace is built")
    return 0
