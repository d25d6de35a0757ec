# SPDX-License-Identifier: Apache-2.0
"""Demonstrations of bent paths, played and led by hand, taught and played again: how far the replay is from them."""

import os

from seed_core.program.command_line import Parser, command, seed_number, to_json, whole
from seed_sim.closed_loop.relative_poses import ESTIMATORS
from seed_sim.teaching.score import campaign, summary, table


@command("seed bench teach")
def main(argv: list[str]) -> int:
    """Command line."""
    parser = Parser(prog="seed bench teach", description=__doc__)
    parser.add_argument("--seeds", type=whole(1), default=20, help="demonstrations; default: %(default)s")
    parser.add_argument("--seed", type=seed_number, default=0, help="the first of them; default: %(default)s")
    parser.add_argument("--estimator", choices=ESTIMATORS, default="noisy", help="default: %(default)s")
    parser.add_argument("--jobs", type=whole(1), default=os.cpu_count() or 1, help="processes; default: one per core")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    o = parser.parse_args(argv)
    replays = campaign(range(o.seed, o.seed + o.seeds), o.estimator, o.jobs)
    result = summary(replays)
    if o.json:
        print(to_json({"seed": o.seed, "kinds": result, "replays": [r._asdict() for r in replays]}))
    else:
        print(table(result))
    return 0
