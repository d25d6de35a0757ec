# SPDX-License-Identifier: Apache-2.0
"""Nonsense for every topic, service, action and parameter of every node and for every file: what comes out of it."""

import json
import time
from typing import Any

from seed_core.program.command_line import Parser, command
from seed_testing.figures import text
from seed_testing.fuzz.files import fuzz_files
from seed_testing.fuzz.run import Findings, fuzz
from seed_testing.fuzz.scenes import SCENES
from seed_testing.fuzz.wire import through_the_wire

FILES = 0.1  # share of the inputs that are files
WIRE = 0.02  # share of them that go through the middleware


def run(inputs: int = 10_000, seed: int = 0) -> dict[str, Any]:
    """Counts, times and growth by node and by kind of file, and each failure with the inputs that lead to it."""
    began = time.monotonic()
    found: dict[str, Findings] = {}
    for name, (_, share) in SCENES.items():
        found[name] = fuzz(name, max(1, inputs * share // 100), seed)
    for name in SCENES:
        found[f"{name} by wire"] = through_the_wire(name, max(1, int(inputs * WIRE / len(SCENES))), seed)
    files = fuzz_files(int(inputs * FILES), seed)
    everything = found | {f"file: {name}": f for name, f in files.items()}
    failures = {
        f"{name}: {failure.words}": f"{failure.count} times; {failure.steps}"
        for name, f in everything.items()
        for failure in f.failures.values()
    } | {f"{name}: grows": f"{f.blocks} blocks, {f.megabytes:.1f} MB" for name, f in found.items() if f.grows}
    return {
        "inputs": sum(f.inputs for f in everything.values()),
        "failures": len(failures),
        **failures,
        "longest_ms": {name: 1e3 * f.longest for name, f in found.items()}
        | {"files": 1e3 * max(f.longest for f in files.values())},
        "grown_mb": {name: f.megabytes for name, f in found.items()},
        "grown_blocks": {name: f.blocks for name, f in found.items()},
        "duration_s": time.monotonic() - began,
    }


@command("seed bench fuzz")
def main(argv: list[str]) -> int:
    """Command line; 1 when something failed."""
    parser = Parser(prog="seed bench fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000, help="how many; default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="what they are drawn from; default: %(default)s")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = parser.parse_args(argv)
    found = run(options.inputs, options.seed)
    print(json.dumps(found) if options.json else "\n".join(text(found)))
    return int(found["failures"] > 0)
