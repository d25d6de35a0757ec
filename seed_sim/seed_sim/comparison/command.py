# SPDX-License-Identifier: Apache-2.0
"""`./seed compare`: this suite and what people use instead, in the same plant, with tables and a page."""

import argparse
import json
import sys
from pathlib import Path

from seed_core.program.command_line import Parser, command, results_folder, seed_number, to_json, whole
from seed_sim.comparison import cases, methods
from seed_sim.comparison.campaign import campaign, scored_in_parallel
from seed_sim.comparison.page import write_page
from seed_sim.comparison.run import Run
from seed_sim.comparison.table import lines_of, text, write_csv
from seed_sim.comparison.tuning import KEPT, chosen_settings, tune, tuning_file, written

SEED, SEEDS, QUICK_SEEDS = 2000, 10, 1


@command("seed compare")
def main(argv: list[str]) -> int:
    """Command line."""
    args = _parser().parse_args(argv)
    chosen = args.method or list(methods.QUICK if args.quick else (m.name for m in methods.METHODS))
    if args.tune:
        return _tune(args, chosen)
    names = args.case or list(cases.QUICK if args.quick else (c.name for c in cases.CASES))
    count = args.seeds or (QUICK_SEEDS if args.quick else SEEDS)
    settings = chosen_settings(chosen, args.tuning)
    seeds = range(args.seed, args.seed + count)
    works = [(Run(m, c, s), dict(settings[m])) for s in seeds for c in names for m in chosen]
    folder = args.out or results_folder() / "compare"
    rows = campaign(works, args.jobs, folder / "runs.jsonl")
    lines = lines_of(rows)
    write_csv(lines, folder / "table.csv")
    write_page(rows, settings, folder / "index.html")
    runs = [{k: v for k, v in r.items() if k != "trace"} for r in rows]
    result = {"lines": [line._asdict() for line in lines], "settings": settings, "seeds": list(seeds), "runs": runs}
    (folder / "compare.json").write_text(to_json(result) + "\n", encoding="utf-8")
    print(to_json(result) if args.json else text(rows))
    print(f"\nwritten: {folder}/index.html, table.csv, compare.json, runs.jsonl", file=sys.stderr)
    return 0


def _tune(args: argparse.Namespace, chosen: list[str]) -> int:
    """Tune the methods one by one, and write each down as it is done."""
    file = args.tuning or tuning_file()
    done = json.loads(file.read_text(encoding="utf-8"))["methods"] if file.is_file() else {}
    for name in chosen:
        method = methods.method_named(name)
        if method.grid:
            print(f"{name}: {len(method.points())} points", file=sys.stderr)
            done[name] = tune(method, lambda works: scored_in_parallel(works, args.jobs), args.kept)
            written(done, file)
            print(f"{name}: cost {done[name]['cost']} with {done[name]['settings']}")
    return 0


def _parser() -> argparse.ArgumentParser:
    p = Parser(
        prog="seed compare",
        description="Press, wipe and step the force with this suite and with what people use instead, in the same\n"
        "simulated cells, each method tuned on a grid on other seeds. Prints who wins what; writes tables.\n"
        "Interrupted, it goes on where it was when it is started again.",
    )
    names = ", ".join(map(repr, methods.ALL))
    more = " and ".join(repr(m.name) for m in methods.FURTHER)
    names = f"{names}; {more} are run only when they are named"
    p.add_argument("--method", action="append", choices=list(methods.ALL), metavar="NAME", help=names)
    names = ", ".join(repr(c.name) for c in cases.CASES)
    p.add_argument("--case", action="append", choices=[c.name for c in cases.CASES], metavar="NAME", help=names)
    p.add_argument("--seeds", type=whole(1), metavar="N", help=f"how many; default: {SEEDS}")
    p.add_argument("--seed", type=seed_number, default=SEED, help="the first")
    p.add_argument("--jobs", type=whole(1), default=2, metavar="J", help="processes")
    p.add_argument("--quick", action="store_true", help="three methods, three cases, one seed")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="default: results/compare")
    p.add_argument("--kept", type=whole(1), default=KEPT, metavar="N", help="tuning: points for further cases")
    p.add_argument("--tune", action="store_true", help="find each method's best settings anew, and write them down")
    p.add_argument(
        "--tuning", type=Path, metavar="FILE", help="settings of the methods; default: those that are shipped"
    )
    p.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return p
