# SPDX-License-Identifier: Apache-2.0
"""./seed teach: path and force of what was shown become a task file that plays again."""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from seed_bringup.commands.cells import cell_arguments, join
from seed_control.parameters import ControllerParameters
from seed_control.tasks import Task, check_fits
from seed_control.teach import TeachSettings, make_task, task_text
from seed_core.config import load_text
from seed_core.errors import SeedError
from seed_core.hand import Tool
from seed_core.program.command_line import Parser, command, interrupts, leaving_at_once, number
from seed_core.program.files import write_text

DEFAULTS = TeachSettings()


@command("seed teach")
def main(argv: list[str]) -> int:
    """Make a task file."""
    options = _parser().parse_args(argv)
    _refuse_file(options.out, options.force)
    settings = replace(DEFAULTS, path=options.path, resists=tuple(options.resists))
    with leaving_at_once("teach"):
        from seed_bringup.teach.shown_bag import heard_in
    if options.bag is not None:
        heard = heard_in(options.bag, options.namespace, options.freedrive)
    else:
        with leaving_at_once("teach"):
            from seed_bringup.teach.ros.live import heard_of
        print(f"seed teach: in {join(options)}", flush=True)
        with interrupts() as check:
            heard = heard_of(check, options.namespace, options.freedrive, options.seconds)
    shown = heard.demonstration()
    made = make_task(shown, options.name or options.out.stem, options.tool, settings)
    check_fits(made.task, replace(Tool(), name=made.task.tool), ControllerParameters())
    how = "played" if heard.played else "led"
    text = task_text(
        made.task, "SPDX-License-Identifier: Apache-2.0", f"Taught by ./seed teach from an arm that was {how}."
    )
    if load_text(text, Task, str(options.out)) != made.task:
        raise SeedError(f"{options.out}: the written task is not the one that was taught; please report this")
    write_text(options.out, text)
    forces = ", ".join(f"{f:g}" for f in made.forces) or "none"
    print(
        f"{options.out}: {shown.stamps[-1] - shown.stamps[0]:.1f} s of an arm that was {how}; forces {forces} N; "
        f"{1e3 * made.length:.0f} mm in contact with {made.corners} corners, points within "
        f"{1e3 * made.uneven:.1f} mm of a plane"
    )
    if heard.choice:
        print(f"seed teach: {heard.choice}", flush=True)
    if heard.doubt:
        print(f"seed teach: some of the forces were in doubt: {heard.doubt}", file=sys.stderr)
    print(f"try it: ./seed evaluate {options.out}; then on the cell: ./seed play {options.out}")
    return 0


def _refuse_file(out: Path, force: bool) -> None:
    """Raises SeedError: the task cannot be written there."""
    if out.exists() and not force:
        raise SeedError(f"{out} exists: name another file, or say --force")
    if out.suffix not in (".yaml", ".yml"):
        raise SeedError(f"{out} must end in .yaml: name the file first, then the bag")
    if not out.absolute().parent.is_dir():
        raise SeedError(f"{out}: there is no folder {out.absolute().parent}: make it first")


def _parser() -> argparse.ArgumentParser:
    p = Parser(
        prog="seed teach",
        description="Make a task file of a demonstration: of a bag, or of a running cell while its arm is led by hand\n"
        "(--freedrive, or pulled by anything else) or plays a task. The tool must be grasped and its pose estimated.",
    )
    p.add_argument("out", type=Path, help="task file to write, such as mine.yaml")
    p.add_argument("bag", nargs="?", type=Path, help="bag of the demonstration; without it a running cell is heard")
    p.add_argument("--name", default="", help="of the task; default: that of the file")
    p.add_argument("--tool", default="", help="that was held; a task without is played with any")
    p.add_argument(
        "--resists",
        default="",
        metavar="AXES",
        help="axes of the tool about which the contact resists a rotation, as x for a blade along y: they carry no "
        "torque; default: none, all angles are held",
    )
    p.add_argument(
        "--path",
        type=number(0.00001, "m", 0.01),
        default=DEFAULTS.path,
        help="[m] by which the path may be simplified; default: %(default)s",
    )
    p.add_argument(
        "--freedrive",
        action="store_true",
        help="the driver lets the arm be led meanwhile; what is played does not count",
    )
    p.add_argument("--seconds", type=number(0.0, "s"), default=0.0, help="[s] to listen; default: until Enter")
    p.add_argument("--force", action="store_true", help="write over an existing file")
    cell_arguments(p)
    return p
