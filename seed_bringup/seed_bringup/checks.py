# SPDX-License-Identifier: Apache-2.0
"""./seed test, lint, shell and build: what developers run inside the environment."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def checkout() -> Path:
    """The repository that ./seed was started from."""
    root = os.environ.get("SEED_ROOT")
    if not root:
        raise SystemExit("seed: this works on a checkout only: start it as ./seed from the repository")
    return Path(root)


def test(argv: list[str]) -> int:
    """Run pytest over every package, or over the paths given; further arguments are pytest's."""
    root = checkout()
    paths = [] if _names_a_path(argv, root) else sorted(str(p.relative_to(root)) for p in root.glob("seed_*/test"))
    command = [sys.executable, "-P", "-m", "pytest", "--durations=15", *_workers(argv), *argv, *paths]
    print(f"seed test: {' '.join(command[3:])}", flush=True)
    # pytest itself returns 5 when it collected nothing.
    return subprocess.run(command, cwd=root).returncode


def _names_a_path(argv: list[str], root: Path) -> bool:
    return any((root / a.split("::")[0]).exists() for a in argv if not a.startswith("-"))


def _workers(argv: list[str]) -> list[str]:
    """Two processes, each file in one of them; alone when a debugger or the caller's own -n is wanted."""
    own = any(a in ("--pdb", "-s", "-n", "--collect-only") or a.startswith(("-n", "--numprocesses")) for a in argv)
    return [] if own else ["-n", "2", "--dist", "loadfile"]


def lint(argv: list[str]) -> int:
    """Ruff's rules and format over everything, mypy strict over the cores; --fix mends what ruff can."""
    root = checkout()
    fix = "--fix" in argv
    ruff = [sys.executable, "-P", "-m", "ruff"]
    commands = [
        [*ruff, "check", *(["--fix"] if fix else []), "."],
        [*ruff, "format", *([] if fix else ["--check"]), "."],
        [sys.executable, "-P", "-m", "mypy", *map(str, cores(root))],
    ]
    codes = []
    for command in commands:
        print(f"seed lint: {' '.join(command[3:5])}", flush=True)
        codes.append(subprocess.run(command, cwd=root).returncode)
    return max(codes)


def cores(root: Path) -> list[Path]:
    """Every module but the edge, relative to the checkout."""
    return [f.relative_to(root) for f in sorted(root.glob("seed_*/seed_*/**/*.py")) if not is_edge(f)]


def is_edge(file: Path) -> bool:
    """Whether a module may know ROS: nodes, the helpers of seed_ros, what reads and writes bags."""
    return file.stem.split("_")[-1] in ("node", "bag") or file.parent.name in ("seed_ros", "bags")


def shell(argv: list[str]) -> int:
    """An interactive shell in the environment, or one command: ./seed shell -c 'ros2 topic list'."""
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
    del argv
    print("seed build: the workspace is built")
    return 0
