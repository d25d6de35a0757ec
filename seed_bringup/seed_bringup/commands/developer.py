# SPDX-License-Identifier: Apache-2.0
"""./seed test, lint, docs, shell and build: what developers run inside the environment."""

import os
import re
import subprocess
import sys
from pathlib import Path

from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command

# pytest's exit codes
PYTEST_USAGE, PYTEST_NOTHING_COLLECTED = 4, 5
HELP = (["-h"], ["--help"])


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
  -n 0          in one process; without it three share the work
Recordings that are no part of the project are looked for in $SEED_DATA; their tests are skipped where it is missing."""


@command("seed test")
def test(argv: list[str]) -> int:
    """Run pytest over every package, or over the paths given; further arguments are pytest's."""
    if argv[:1] in HELP:
        print(TEST_HELP)
        return 0
    root = checkout()
    argv = [a for a in argv if a != "--"]
    there = {a for a in argv if not a.startswith("-") and (root / a.split("::")[0]).exists()}
    free = [a for a, before in zip(argv, ["", *argv], strict=False) if "-" not in (a[:1], before[:1])]  # of no option
    missing = [a for a in free if a not in there and (a.startswith("seed_") or "/" in a or "::" in a)]
    if missing:
        raise SeedError(f"there is no {', '.join(missing)} in {root}")
    paths = [] if there else sorted(str(p.relative_to(root)) for p in root.glob("seed_*/test"))
    # One process runs against the clock and mostly waits, two compute, each file in one of them.
    # Alone when a debugger or the caller's own -n is wanted.
    alone = any(a in ("--pdb", "-s", "--collect-only") or a.startswith(("-n", "--numprocesses")) for a in argv)
    workers = [] if alone else ["-n", "3", "--dist", "loadfile"]
    pytest = [sys.executable, "-P", "-m", "pytest", "--durations=15", *workers, *argv, *paths]
    print(f"seed test: {' '.join(pytest[3:])}", flush=True)
    code = subprocess.run(pytest, cwd=root).returncode
    return 2 if code in (PYTEST_USAGE, PYTEST_NOTHING_COLLECTED) else min(code, 1)


@command("seed lint")
def lint(argv: list[str]) -> int:
    """Ruff's rules and format over everything, mypy strict over the cores; --fix mends what ruff can."""
    if argv[:1] in HELP:
        print("usage: ./seed lint [--fix]\n\n" + (lint.__doc__ or ""))
        return 0
    if argv not in ([], ["--fix"]):
        raise SeedError(f"takes --fix and nothing else, not {' '.join(argv)}")
    root = checkout()
    failed = []
    layout = ["ruff", "format", *([] if argv else ["--check"]), "."]
    first = [layout] if argv else []  # a line that it breaks is not too long for the rules any more
    for words in (*first, ["ruff", "check", *argv, "."], layout, ["mypy", *map(str, cores(root))]):
        print(f"seed lint: {' '.join(words[:2])}", flush=True)
        if subprocess.run([sys.executable, "-P", "-m", *words], cwd=root).returncode:
            failed.append(" ".join(words[:2]))
    print(f"seed lint: {'failed: ' + ', '.join(failed) if failed else 'all is well'}")
    return int(bool(failed))


def cores(root: Path) -> list[Path]:
    """Every module but the edge, relative to the checkout."""
    return [f.relative_to(root) for f in sorted(root.glob("seed_*/seed_*/**/*.py")) if not is_edge(f)]


def is_edge(file: Path) -> bool:
    """Whether a module may know ROS: ros/, bags/, seed_ros, and modules named after a node or a bag."""
    return bool({"ros", "bags", "seed_ros"} & set(file.parts[-3:-1])) or file.stem.split("_")[-1] in ("node", "bag")


DOCS_HELP = """\
usage: ./seed docs [--out FOLDER] [--serve]

Build the site of docs/, strictly: a link, an anchor or a page that leads nowhere fails. Links to other servers are
listed, not fetched, and the site itself asks nothing of any.

  --out FOLDER   default: build/site; open index.html in it
  --serve        show it on http://127.0.0.1:8000, built again at every change"""


@command("seed docs")
def docs(argv: list[str]) -> int:
    """Build the site with MkDocs, or serve it on loopback."""
    parser = Parser(prog="seed docs", add_help=False)
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--serve", action="store_true")
    options = parser.parse_args(argv)
    if options.help:
        print(DOCS_HELP)
        return 0
    root = checkout()
    out = (options.out or root / "build" / "site").resolve()
    words = ["serve", "--dev-addr", "127.0.0.1:8000"] if options.serve else ["build", "--site-dir", str(out)]
    # Not --quiet, which hides warnings from --strict too. Material announces its successor at every build.
    mkdocs = [sys.executable, "-P", "-m", "mkdocs", *words, "--strict", "--config-file", "mkdocs.yml"]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    if options.serve:
        return subprocess.run(mkdocs, cwd=root, env=environment).returncode
    done = subprocess.run(mkdocs, cwd=root, env=environment, capture_output=True, text=True)
    if done.returncode:
        print("\n".join(x for x in done.stderr.splitlines() if not x.startswith("INFO")), file=sys.stderr)
        return 1
    outside = external_links(root)
    print(f"seed docs: {out / 'index.html'}; {len(outside)} links to other servers, not fetched:")
    print("\n".join(f"  {link}" for link in outside))
    return 0


def external_links(root: Path) -> list[str]:
    """Addresses of other servers that the documents link to."""
    pages = [root / "README.md", root / "CONTRIBUTING.md", *sorted((root / "docs").glob("**/*.md"))]
    return sorted({link for page in pages for link in re.findall(r"\]\((https?://[^)\s]+)\)", page.read_text())})


@command("seed shell")
def shell(argv: list[str]) -> int:
    """An interactive shell in the environment, or one command: ./seed shell -c 'python tool.py'."""
    if argv[:1] not in HELP:
        if not argv:
            where = os.environ.get("VIRTUAL_ENV", "")
            print(f"seed shell: {where}; leave with exit or Ctrl-D", file=sys.stderr, flush=True)
        program = os.environ.get("SHELL", "/bin/bash")
        os.execvp(program, [program, *argv])
    print(f"usage: ./seed shell [-c COMMAND | ARGUMENTS OF THE SHELL]\n\n{shell.__doc__}")
    return 0


def build(argv: list[str]) -> int:
    """The bootstrap has built the workspace (arguments went to CMake); say so."""
    if argv[:1] in HELP:
        print("usage: ./seed build [-DNAME=VALUE ...]\n\nBuild every package again; a start does so where it must.")
    else:
        print("seed build: the workspace is built")
    return 0
