# SPDX-License-Identifier: Apache-2.0
"""./seed bench load: the commands of the first day on a machine that is busy, again and again.

Programs that only count take the cores beside them. In turn: a demo from start to report, and a task played in one cell
that runs by simulated time, by the commands that the documents name.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from seed_bringup.launching.domains import OWN, claimed
from seed_core.errors import FailedError
from seed_core.program.command_line import Parser, command, seed_number, whole
from seed_testing.bench.processes import BUSY, processes

STARTS_WITHIN = 180.0  # [s] of a cell on such a machine
PATIENCE = 1200.0  # [s] of one command
PREPARED = (
    ("call", "sim/release"),  # of a task before, and refused where nothing is held
    ("call", "estimator/capture_reference"),
    ("call", "sim/grasp"),
    ("call", "estimator/initialize_grasp"),
)


@command("seed bench load")
def main(argv: list[str]) -> int:
    """Print a line for each command; 1 when one failed."""
    p = Parser(prog="seed bench load", description=__doc__)
    p.add_argument("--busy", type=whole(0), default=20, help="programs that count meanwhile")
    p.add_argument("--demos", type=whole(0), default=20, help="./seed demo, each with a seed of its own")
    p.add_argument("--plays", type=whole(0), default=20, help="./seed play squeegee in a cell by simulated time")
    p.add_argument(
        "--world", choices=("known", "hidden"), default="known", help="of the demos; a hidden one is identified first"
    )
    p.add_argument("--seed", type=seed_number, default=1, help="of the first demo")
    p.add_argument("--out", type=Path, default=Path("results/load"), help="folder for what was said, and load.json")
    o = p.parse_args(argv)
    o.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    try:
        with claimed(OWN, "seed bench load"), processes(*[BUSY] * o.busy):
            for row in run(o):
                rows.append(row)
                print(line(row), flush=True)
    finally:
        (o.out / "load.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        print("\n".join(words(rows)))
    return 1 if any(row["code"] for row in rows) else 0


def run(o: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows as they come: command, its exit code, seconds, the load, and the last line that it said."""
    for number in range(o.demos):
        seed = str(o.seed + number)
        out = str(o.out / f"demo-{seed}")
        yield said("demo", "--seed", seed, "--world", o.world, "--out", out)
    if o.plays:
        with cell(o.out / "cell.log"):
            whole = False
            for _ in range(o.plays):
                if not whole:
                    prepare()
                said("call", "controller/enable", "on")
                row = said("play", "squeegee")
                yield row
                whole = not row["code"]


def said(*words: str) -> dict[str, Any]:
    """Run one ./seed command to its end."""
    began = time.monotonic()
    program = [sys.executable, "-P", "-m", "seed_bringup.commands.dispatch", *words]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        out, err = process.communicate(timeout=PATIENCE)
    except BaseException:
        process.send_signal(signal.SIGINT)  # it has nodes to end
        process.communicate()
        raise
    spoken = err if process.returncode else out or err
    last = next((x.strip() for x in reversed(spoken.splitlines()) if x.strip()), "")
    return {
        "command": " ".join(words),
        "code": process.returncode,
        "seconds": time.monotonic() - began,
        "load": os.getloadavg()[0],
        "said": last,
    }


def prepare() -> None:
    """Do what a session begins with. Raises FailedError: the cell does not come to it."""
    end = time.monotonic() + STARTS_WITHIN
    for words in PREPARED:
        while (row := said(*words))["code"] and words != PREPARED[0]:
            if time.monotonic() > end:
                raise FailedError(f"{row['command']}: {row['said']}")


@contextmanager
def cell(log: Path) -> Iterator[None]:
    """A cell by simulated time, as ./seed launch starts it."""
    program = [sys.executable, "-P", "-m", "seed_bringup.commands.dispatch", "launch", "cell", "use_sim_time:=true"]
    with log.open("w", encoding="utf-8") as file:
        process = subprocess.Popen(program, stdout=file, stderr=file)
        try:
            yield
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()


def line(row: dict[str, Any]) -> str:
    """Of the table."""
    end = "well" if not row["code"] else f"exit {row['code']}"
    name = row["command"].split(" --world")[0]
    return f"{name:<24} {end:<8} {row['seconds']:5.0f} s  load {row['load']:4.1f}  {row['said']}"


def words(rows: list[dict[str, Any]]) -> Iterator[str]:
    """What came of it."""
    for name in ("demo", "play"):
        of = [row for row in rows if row["command"].startswith(name)]
        if of:
            well = sum(not row["code"] for row in of)
            seconds, load = median(row["seconds"] for row in of), median(row["load"] for row in of)
            yield f"{name}: {well} of {len(of)} well, median {seconds:.0f} s, load {load:.0f}"
