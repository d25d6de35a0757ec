# SPDX-License-Identifier: Apache-2.0
"""`./seed reproduce fig4|fig6|fig7`: the paper's figures as figures and tables, from simulation."""

import argparse
from pathlib import Path

from seed_control.tasks import LEAST_FORCE, MOST_FORCE
from seed_core.program.command_line import Parser, command, number, results_folder, seed_number
from seed_testing.reproduce import fig4, fig6, fig7


@command("seed reproduce")
def main(argv: list[str]) -> int:
    """Command line."""
    args = _parser().parse_args(argv)
    folder = args.out or results_folder() / args.figure
    folder.mkdir(parents=True, exist_ok=True)
    if args.figure == "fig4":
        text, files = fig4.reproduce(folder, args.seed)
    elif args.figure == "fig6":
        text, files = fig6.reproduce(folder, args.seed, args.force)
    else:
        text, files = fig7.reproduce(folder, args.seed, args.text)
    print(text)
    print("\nwritten: " + ", ".join(str(f) for f in files))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="seed reproduce",
        description="The paper's figures again, in simulation: fig4 (tracking of the relative pose), fig6 (squeegee:\n"
        "SEED, open loop, welded), fig7 (pen strokes and writing). A few minutes each.",
    )
    parser.add_argument("figure", choices=("fig4", "fig6", "fig7"), help="which of them")
    parser.add_argument("--seed", type=seed_number, default=1000, help="draws table, arm and noise")
    parser.add_argument(
        "--force", type=number(LEAST_FORCE, "N", MOST_FORCE), default=10.0, help="[N] of the squeegee (fig6)"
    )
    parser.add_argument("--text", default="SEED", help="what the pen writes (fig7)")
    parser.add_argument("--out", type=Path, help="folder; default: results/FIGURE")
    return parser
