# SPDX-License-Identifier: Apache-2.0
"""The force over the whole of a wipe, from its first millimetre, under each condition; and how fast it follows."""

import os
from pathlib import Path

import numpy as np

from seed_control.parameters import LAW_HELP, LAWS
from seed_core.program.command_line import Parser, command, seed_number, to_json, whole
from seed_sim.wipes.campaign import bandwidths, campaign, summary, table
from seed_sim.wipes.conditions import CONDITIONS


@command("seed bench law")
def main(argv: list[str]) -> int:
    """Command line."""
    parser = Parser(prog="seed bench law", description=__doc__)
    parser.add_argument("--seeds", type=whole(0), default=20, help="wipes per condition; default: %(default)s")
    parser.add_argument("--seed", type=seed_number, default=0, help="the first of them; default: %(default)s")
    parser.add_argument(
        "--only", choices=CONDITIONS, action="append", help="only this condition; may be given more than once"
    )
    parser.add_argument("--law", choices=LAWS, default="seed", help=LAW_HELP)
    parser.add_argument(
        "--bandwidth", type=whole(0), default=0, metavar="N", help="with so many seeds, how fast the force follows"
    )
    parser.add_argument("--jobs", type=whole(1), default=os.cpu_count() or 1, help="processes; default: one per core")
    parser.add_argument("--out", type=Path, metavar="FILE", help="keep each wipe as a line of JSON, and go on from it")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    o = parser.parse_args(argv)
    seeds = range(o.seed, o.seed + o.seeds)
    result = summary(campaign(o.only or list(CONDITIONS), seeds, o.law, o.jobs, o.out)) if seeds else {}
    found = bandwidths(range(o.seed, o.seed + o.bandwidth), o.law, o.jobs)
    if o.json:
        print(to_json({"law": o.law, "seed": o.seed, "conditions": result, "bandwidth_hz": found}))
        return 0
    if seeds:
        print(table(result))
    for amplitude, hz in found.items() if o.bandwidth else ():
        print(f"bandwidth, sines of {amplitude:.1f} N: {np.median(hz):.1f} Hz median, {min(hz):.1f} Hz at least")
    return 0
