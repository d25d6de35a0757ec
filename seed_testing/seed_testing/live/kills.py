# SPDX-License-Identifier: Apache-2.0
"""./seed bench kills: each node of a live cell is killed, stopped or started anew in each phase of a task."""

import argparse
import itertools
import json
import os
import random
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from seed_bringup.launching.domains import OWN, claimed
from seed_core.errors import FailedError, SeedError
from seed_core.program.command_line import Parser, command, seed_number, whole
from seed_testing.live.verdict import faults_of

PHASES = ("reference", "grasped", "enabled", "press", "wipe", "lift")
FAULTS = ("kill", "stop 0.5 s", "stop 5 s", "restart")
NODES = {
    "sim": ("controller", "estimator", "bubbles", "sim"),
    "ur": ("controller", "estimator", "bubbles", "sim", "driver", "driver/servo", "ur_controller"),
}
DISTURBED = 3  # times that a case is tried when a busy machine ends the cell's health before the fault
HEAD = (
    f"{'robot':<5} {'node':<13} {'fault':<10} {'phase':<9} {'held s':>6} {'mm':>5} {'mm/s':>5} {'N':>5}  what it said"
)


def _parser() -> argparse.ArgumentParser:
    p = Parser(prog="seed bench kills", description=__doc__)
    p.add_argument("--robots", nargs="+", choices=tuple(NODES), default=list(NODES), help="arm of the cell")
    p.add_argument("--nodes", nargs="+", choices=NODES["ur"], default=list(NODES["ur"]), help="which end")
    p.add_argument("--phases", nargs="+", choices=PHASES, default=list(PHASES), help="of the task, at the fault")
    p.add_argument("--faults", nargs="+", choices=FAULTS, default=list(FAULTS), help="how they end")
    p.add_argument("--method", default="rigid_fit", choices=("rigid_fit", "truth"), help="truth: without images")
    p.add_argument("--random", type=whole(0), default=0, help="so many random sequences of 1 to 3 faults instead")
    p.add_argument("--seed", type=seed_number, default=1, help="of the sequences")
    p.add_argument(
        "--out", type=Path, default=Path("results/kills.json"), help="file for the table; goes on from what it holds"
    )
    return p


Case = tuple[str, str, str, str]  # robot, node, fault, phase
NOT_A_FAULT = ("driver/servo", "restart")  # only its node ends the servo process: it does not hear an interrupt


def table(o: argparse.Namespace) -> list[list[Case]]:
    """Sequences of cases: one each, or random ones."""
    robots = [r for r in NODES if r in o.robots]
    if o.random:
        rng = random.Random(o.seed)
        return [_sequence(o, rng, rng.choice(robots)) for _ in range(o.random)]
    product = itertools.product
    return [
        [(r, *case)]
        for r in robots
        for case in product(nodes_of(o, r), o.faults, [p for p in PHASES if p in o.phases])
        if case[:2] != NOT_A_FAULT
    ]


def _sequence(o: argparse.Namespace, rng: random.Random, robot: str) -> list[Case]:
    faults = [(n, f) for n in nodes_of(o, robot) for f in o.faults if (n, f) != NOT_A_FAULT]
    return [(robot, *rng.choice(faults), rng.choice(o.phases)) for _ in range(rng.randint(1, 3))]


def nodes_of(o: argparse.Namespace, robot: str) -> list[str]:
    """Those asked for that the cell has."""
    without = ("estimator", "bubbles") if o.method == "truth" else ()
    return [n for n in NODES[robot] if n in o.nodes and n not in without]


@command("seed bench kills")
def main(argv: list[str]) -> int:
    """Print the table as it grows, write it as JSON; 1 when a case is not well."""
    o = _parser().parse_args(argv)
    sequences = table(o)
    if not any(sequences):
        raise SeedError("none of these nodes is in these cells")
    o.out.parent.mkdir(parents=True, exist_ok=True)
    print(
        f"{sum(map(len, sequences))} cases in {len(sequences)} sequences; load {os.getloadavg()[0]:.1f}\n{HEAD}",
        flush=True,
    )
    rows = kept(o.out, sequences, o.method)
    for row in rows:
        print(line(row), flush=True)
    to_do = {number: s for number, s in enumerate(sequences) if number not in {r["sequence"] for r in rows}}
    ended, sequence = False, list[dict[str, Any]]()
    try:
        with claimed(OWN, "seed bench kills"):
            for row in run(to_do, o.method, o.out.with_suffix(".log")):
                sequence.append(row | {"method": o.method})
                print(line(row), flush=True)
                if len(sequence) == len(to_do[row["sequence"]]):
                    rows, sequence = rows + sequence, []
                    o.out.write_text(json.dumps({"cases": rows}, indent=1) + "\n", encoding="utf-8")
    except KeyboardInterrupt:
        ended = True
    bad = [r for r in rows if r["wrong"]]
    missed = [r for r in rows if not r["reached"]]
    words = f"{len(rows)} cases, {len(bad)} not well, {len(missed)} not reached, load {os.getloadavg()[0]:.1f}; {o.out}"
    print(words)
    if ended:
        raise KeyboardInterrupt
    return 1 if bad or len(missed) == len(rows) else 0


def kept(file: Path, sequences: list[list[Case]], method: str) -> list[dict[str, Any]]:
    """Rows of those sequences that a file holds from start to end, every case reached; numbered as they are now."""
    if not file.is_file():
        return []
    whole: dict[int, list[dict[str, Any]]] = {}
    for row in json.loads(file.read_text(encoding="utf-8"))["cases"]:
        whole.setdefault(row["sequence"], []).append(row)
    there = {
        tuple((r["robot"], r["node"], r["fault"], r["phase"]) for r in rows): rows
        for rows in whole.values()
        if all(r["reached"] and r.get("method") == method for r in rows)
    }
    found = ((number, there.get(tuple(s), [])) for number, s in enumerate(sequences))
    return [row | {"sequence": number} for number, rows in found for row in rows]


def run(sequences: Mapping[int, list[Case]], method: str, log: Path) -> Any:
    """Rows of the table as they come; sequences: by their numbers."""
    from seed_testing.live.ros.fault_cell import FaultCell

    cell: FaultCell | None = None
    try:
        for number, sequence in sequences.items():
            for case in sequence:
                for attempt in range(DISTURBED):
                    if cell is not None and (cell.spoiled or cell.robot != case[0]):
                        cell.close()
                        cell = None
                    try:
                        cell = cell or FaultCell(case[0], method, log).open()
                        row = cell.run(*case[1:])
                    except FailedError as error:
                        if cell is not None:
                            cell.spoiled = True
                        if attempt + 1 == DISTURBED:
                            row = _failed(case, str(error))
                        else:
                            continue
                    break
                row |= {"sequence": number, "load": os.getloadavg()[0], "at": time.strftime("%H:%M:%S")}
                row["wrong"] = faults_of(row) if row["reached"] else []
                yield row
    finally:
        if cell is not None:
            cell.close()


def _failed(case: Case, why: str) -> dict[str, Any]:
    """A case that could not be brought to its fault: the machine is too busy for a cell by the wall's clock."""
    names = ("robot", "node", "fault", "phase")
    return {**dict(zip(names, case, strict=True)), "reached": False, "state": f"not reached: {why}"}


def line(row: dict[str, Any]) -> str:
    """One row for people."""
    keys = ("held_after_s", "travel_mm", "speed_mm_s", "force_n")
    held, way, speed, force = (
        "-" if row.get(k) is None else f"{row[k]:.{2 if i == 0 else 1}f}" for i, k in enumerate(keys)
    )
    said = f"WRONG: {'; '.join(row['wrong'])}; " if row["wrong"] else ""
    said += row.get("state") or row.get("diagnostics") or ""
    case = f"{row['robot']:<5} {row['node']:<13} {row['fault']:<10} {row['phase']:<9}"
    return f"{case} {held:>6} {way:>5} {speed:>5} {force:>5}  {said}"
