# SPDX-License-Identifier: Apache-2.0
"""./seed recordings: the estimator against recordings that no renderer made; they are no part of the project.

The recorded press goes through the real estimator node, image by image; recorded infrared
images are turned and shifted by known amounts and followed. Exit code 0 only if all is within its bounds.
"""

import argparse
import json
import os
from pathlib import Path

from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command
from seed_testing.recordings import infrared as real_ir
from seed_testing.recordings import press

PRESS, INFRARED = "uiuc_punyo_d405_dev.npz", "picoflexx_ir_dev.npz"


@command("seed recordings")
def main(argv: list[str]) -> int:
    """Prints one JSON object per recording."""
    options = _parser().parse_args(argv)
    good = True
    for asked, name, other in ((options.press, PRESS, "infrared"), (options.infrared, INFRARED, "press")):
        if asked is None and options.only != other and not (folder() / name).is_file():
            raise SeedError(f"no {name} in {folder()}: the recordings are no part of the project; SEED_DATA says where")
    if options.only != "infrared":
        from seed_testing.recordings.press_node import through_node

        found = through_node(press.load(options.press or folder() / PRESS))
        print(json.dumps({"press": found._asdict(), "good": found.good}), flush=True)
        good &= found.good
    if options.only != "press":
        good &= real_ir.report(options.infrared or folder() / INFRARED)
    return 0 if good else 1


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="seed recordings", description=__doc__)
    parser.add_argument("--only", choices=("press", "infrared"), help="one of the two")
    parser.add_argument("--press", type=Path, help=f"npz of a press; default: $SEED_DATA/{PRESS}")
    parser.add_argument("--infrared", type=Path, help=f"npz of infrared images; default: $SEED_DATA/{INFRARED}")
    return parser


def folder() -> Path:
    """Where recordings lie: $SEED_DATA, else shared/data beside the checkout."""
    root = Path(os.environ.get("SEED_ROOT") or Path(__file__).resolve().parents[3])
    return Path(os.environ.get("SEED_DATA") or root.parent / "shared" / "data")
