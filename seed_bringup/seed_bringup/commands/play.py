# SPDX-License-Identifier: Apache-2.0
"""./seed play: a task on a running cell, also where there is no `ros2` command."""

import math
import sys
from contextlib import closing
from typing import Any

from seed_bringup.commands.cells import await_start, cell_arguments, join
from seed_bringup.demo.terminal import Bar, done_in
from seed_control.tasks import LEAST_FORCE, MOST_FORCE, load_task, shipped_tasks
from seed_core.errors import FailedError
from seed_core.program.command_line import Parser, command, interrupts, leaving_at_once, number


@command("seed play")
def main(argv: list[str]) -> int:
    """Play a task to its end."""
    p = Parser(
        prog="seed play",
        description="Play a task on a running cell whose controller is enabled. Ctrl-C cancels it: the tool is\n"
        "lifted, as it is when this program ends in another way. A second Ctrl-C does not wait for that.",
    )
    p.add_argument("task", help=f"a task file, or a shipped task: {', '.join(shipped_tasks())}")
    p.add_argument(
        "--force",
        type=number(LEAST_FORCE, "N", MOST_FORCE),
        help="[N] size of every force in the task; its own if left out",
    )
    cell_arguments(p)
    options = p.parse_args(argv)
    load_task(options.task, options.force)  # says here and now what is wrong with it
    with leaving_at_once("play"):
        from seed_bringup.ros.session import Session  # rclpy only from here on
    cell = join(options)
    with (
        interrupts() as check,
        closing(Session(check, namespace=options.namespace)) as session,
        closing(Bar()) as bar,
    ):

        def tell(feedback: Any) -> None:
            bar.show(feedback.phase, feedback.progress, session.pressing_force)

        def cancelling() -> None:
            print("\nseed play: cancelling: the tool is lifted", file=sys.stderr, flush=True)

        session.cancelling = cancelling
        await_start(session, lambda: "controller" in session.node.get_node_names(), "seed play")
        print(f"seed play: {session.arm()} in {cell}", file=sys.stderr, flush=True)
        try:
            result = session.play(options.task, options.force, tell, patience=math.inf).result
        except KeyboardInterrupt:
            raise KeyboardInterrupt(_ending(session.played.result)) from None
    if not result.success:
        raise FailedError(result.message)
    print(done_in(result.duration, result.force_rmse))
    return 0


def _ending(result: Any) -> str:
    """What became of arm and tool after Ctrl-C; result: of the task, None where none was played."""
    if result is None:
        return "the task had not begun"
    if result.message == "cancelled":
        return "the task is cancelled, and the tool lifted"
    return f"the task is {result.message}"
