# SPDX-License-Identifier: Apache-2.0
"""./seed view: the operator page of a running cell, or of a bag."""

import argparse
from pathlib import Path

from seed_bringup.commands.cells import cell_arguments, in_root, join
from seed_bringup.page.server import PORT
from seed_control.tasks import load_task
from seed_core.program.command_line import Parser, command, leaving_at_once, whole
from seed_ur.models import MODELS


@command("seed view")
def main(argv: list[str]) -> int:
    """Serve the page until Ctrl-C."""
    p = Parser(
        prog="seed view",
        description="Serve the operator page, in a browser on this computer: the cell in 3-D, forces, tactile\n"
        "pictures, and buttons from Reference to Stop. It may be opened before the cell. From another computer:\n"
        "ssh -L 8080:127.0.0.1:8080 THIS_COMPUTER. With a bag it plays that, with a time slider.",
    )
    p.add_argument("bag", nargs="?", type=Path, help="folder or file of a bag; without it: a running cell")
    p.add_argument("--port", type=whole(0, 65535), default=PORT, help="of the page; if taken, the next free one")
    p.add_argument("--task", action="append", default=[], help="file of an own task, to be offered as well")
    p.add_argument("--model", choices=tuple(MODELS), default="ur5e", help="arm that is drawn")
    cell_arguments(p)
    options = p.parse_args(argv)
    if options.bag is not None:
        return _play(options)
    tasks = [str(Path(t).resolve()) for t in options.task]
    for task in tasks:
        load_task(task)  # says here and now what is wrong with it
    join(options)
    with leaving_at_once("view"):
        from seed_bringup.page.ros.node import serve
    if failed := serve(in_root(options.namespace), options.port, options.model, tasks):
        return failed
    raise KeyboardInterrupt  # it serves until then


def _play(options: argparse.Namespace) -> int:
    with leaving_at_once("view"):
        from seed_bringup.page.ros.playback import play
    return play(options.bag, options.port, options.model)
