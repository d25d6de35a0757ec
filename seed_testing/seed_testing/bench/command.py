# SPDX-License-Identifier: Apache-2.0
"""./seed bench: figures of speed on this machine, and long campaigns on a live cell."""

import importlib
import json
from typing import Any

from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command
from seed_core.program.suggestions import did_you_mean
from seed_testing.figures import text

BENCHES = {
    "estimator": "seed_testing.bench.estimator",
    "gel": "seed_testing.bench.gel",
    "control": "seed_testing.bench.control",
    "membrane": "seed_testing.bench.membrane",
    "gym": "seed_testing.bench.gym",
    "driver": "seed_testing.bench.driver",
    "clearances": "seed_testing.bench.clearances",
    "slider": "seed_testing.fault_bench.slider",
    "driver_node": "seed_testing.bench.ros.driver_rate",
    "node": "seed_testing.bench.ros.pose_age",
}
LONG = {  # commands with arguments of their own
    "cameras": "seed_testing.bench.ros.camera_rate",
    "kills": "seed_testing.live.kills",
    "soak": "seed_testing.live.soak",
    "load": "seed_testing.live.load",
    "page": "seed_testing.live.page_cost",
    "fuzz": "seed_testing.bench.fuzz",
    "law": "seed_testing.bench.campaigns.law",
    "teach": "seed_testing.bench.campaigns.teach",
    "insertion": "seed_testing.bench.campaigns.insertion",
    "hosts": "seed_testing.two_hosts.command",
}


ALL = "all"
LIST = f"""\
figures of speed, each in seconds or minutes:  {", ".join(BENCHES)}
by itself, with arguments of its own:          {", ".join(LONG)}
./seed bench NAME ... runs those, ./seed bench {ALL} every one of the first line."""


def run(names: list[str]) -> dict[str, Any]:
    """Figures by name of the benchmark; `all` names every one.

    Raises:
        SeedError: a name that is no benchmark.
    """
    for name in names:
        if name not in (*BENCHES, ALL):
            there = f"{', '.join(BENCHES)}, {ALL}, and alone {', '.join(LONG)}"
            raise SeedError(f"no benchmark '{name}'; there are: {there}{did_you_mean(name, (*BENCHES, *LONG))}")
    chosen = BENCHES if ALL in names else names
    return {name: importlib.import_module(BENCHES[name]).run() for name in chosen}


@command("seed bench")
def main(argv: list[str]) -> int:
    """Command line."""
    if argv[:1] and argv[0] in LONG:
        return int(importlib.import_module(LONG[argv[0]]).main(argv[1:]))
    parser = Parser(prog="seed bench", description=__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"of {', '.join(BENCHES)}; {ALL}: every one of these; or alone {', '.join(LONG)}; without one: the list",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = parser.parse_args(argv)
    if not options.names:
        print(LIST)
        return 0
    results = run(options.names)
    if options.json:
        print(json.dumps(results))
    else:
        for name, values in results.items():
            print("\n".join([name, *text(values)]))
    return 0
