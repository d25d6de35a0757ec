# SPDX-License-Identifier: Apache-2.0
"""Random sequences of faults, each drawn from a seed: nothing may hang, crash, leak or move unasked.

    python -m seed_testing.fault_bench.sequences --count 200 --seed 1

A sequence is one to four faults with random pauses, some striking while another is not healed, on one life of the
driver. Prints a line per sequence and a JSON summary; exit code 1 when any failed.
"""

import contextlib
import json
import os
import random
import sys
import time
from pathlib import Path
from typing import Any

from seed_core.errors import SeedError
from seed_core.program.command_line import Parser
from seed_testing.fault_bench.bench import FaultBench, leftover_processes
from seed_testing.fault_bench.faults import FAULTS, REST_WITHIN, Fault

LIMIT = 60.0  # [s] a sequence may take


def play(bench: FaultBench, rng: random.Random, names: list[str], holds: list[str]) -> None:
    """One sequence. Raises SeedError when something goes wrong.

    Args:
        names: gets the names of its faults.
        holds: gets the reasons of holds between them: a pause of this machine is a silent robot, and only a request
            ends a hold.
    """
    bench.ready()
    for _ in range(rng.randint(1, 4)):
        if not bench.step().armed:
            holds += [bench.state.reason]
            bench.recover()
        bench.sway(rng.uniform(0.005, 0.02), rng.uniform(1.0, 3.0))
        bench.run(rng.uniform(0.0, 0.4))
        chosen = rng.sample(FAULTS, 2 if rng.random() < 0.25 else 1)
        names += [" + ".join(f.name for f in chosen)]
        _inject(bench, chosen, rng)
        bench.still()
        _undo(bench, chosen)
        bench.recover_in_place()


def _inject(bench: FaultBench, chosen: list[Fault], rng: random.Random) -> None:
    start = time.monotonic()
    for fault in chosen:
        with contextlib.suppress(OSError):  # the first fault may have taken the controller away from the second
            fault.inject(bench)
        bench.run(rng.uniform(0.0, 0.3))
    bench.wait(lambda s: not s.armed, 5.0, "report")
    rest = sum(f.frozen for f in chosen) + REST_WITHIN
    bench.run(rest)
    bench.travel(start, rest_from=start + 0.3 + rest)


def _undo(bench: FaultBench, chosen: list[Fault]) -> None:
    killed = [f for f in chosen if f.name == "controller killed"]
    if killed:
        bench.robot.kill()
        bench.robot.start()
    for fault in chosen:
        if fault not in killed:
            fault.undo(bench)


def run(count: int, seed: int, talk: bool = False, first: int = 0) -> dict[str, Any]:
    """Play `count` sequences from number `first` on.

    Returns:
        {count, seed, failed: [{sequence, error}], faults, holds, seconds, leaked_processes, leaked_descriptors,
        leaked_shared_memory}.
    """
    start, descriptors = time.monotonic(), len(os.listdir("/proc/self/fd"))
    faults = 0
    holds: list[str] = []
    failed: list[dict[str, Any]] = []
    memories: set[int] = set()
    for number in range(first, first + count):
        rng, began = random.Random(f"{seed}/{number}"), time.monotonic()
        names: list[str] = []
        result = "ok"
        try:
            program = rng.choice(("paused", "stopped", "playing"))  # in a protective stop
            with FaultBench("--unlock-after", "0.2", "--on-stop", program) as bench:
                if bench.supervisor.memory is not None:
                    memories.add(os.fstat(bench.supervisor.memory.fd).st_ino)
                play(bench, rng, names, holds)
            if time.monotonic() - began > LIMIT:
                raise SeedError(f"took {time.monotonic() - began:.0f} s, limit {LIMIT} s")
        except SeedError as error:
            result = str(error)
            failed.append({"sequence": number, "error": result})
        faults += len(names)
        if talk:
            print(f"{number:4d}  {time.monotonic() - began:5.1f} s  {result}  [{'; '.join(names)}]", flush=True)
    return {
        "count": count,
        "seed": seed,
        "failed": failed,
        "faults": faults,
        "holds": holds,
        "seconds": round(time.monotonic() - start, 1),
        "leaked_processes": leftover_processes(os.getpid()),
        "leaked_descriptors": len(os.listdir("/proc/self/fd")) - descriptors,
        "leaked_shared_memory": _holders(memories),
    }


def _holders(memories: set[int]) -> list[str]:
    """Descriptors, of any process, of one of these shared memories, which are given by their inodes."""
    held = []
    for descriptor in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):  # closed meanwhile, or somebody else's
            if "memfd:seed_driver" in os.readlink(descriptor) and descriptor.stat().st_ino in memories:
                held.append(str(descriptor))
    return held


def main() -> int:
    """Command line."""
    parser = Parser(prog="seed_testing.fault_bench.sequences", description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first sequence, to go on where one stopped")
    given = parser.parse_args()
    result = run(given.count, given.seed, talk=True, first=given.first)
    print(json.dumps(result))
    leaked = result["leaked_processes"] or result["leaked_shared_memory"] or result["leaked_descriptors"] > 0
    return 1 if result["failed"] or leaked else 0


if __name__ == "__main__":
    sys.exit(main())
