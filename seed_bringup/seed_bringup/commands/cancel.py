# SPDX-License-Identifier: Apache-2.0
"""./seed cancel: ends the task that a running cell plays, whoever began it."""

from contextlib import closing

from seed_bringup.commands.cells import cell_arguments, join
from seed_core.errors import FailedError
from seed_core.program.command_line import Parser, command, interrupts, leaving_at_once


@command("seed cancel")
def main(argv: list[str]) -> int:
    """Cancel; 1 when no task is played."""
    p = Parser(prog="seed cancel", description="End the task that is played, whoever began it: the tool is lifted.")
    cell_arguments(p)
    options = p.parse_args(argv)
    join(options)
    with leaving_at_once("cancel"):
        from seed_bringup.ros.session import Session  # rclpy only from here on
    with interrupts() as check, closing(Session(check, follow=False, namespace=options.namespace)) as session:
        if not session.cancel_all():
            raise FailedError("no task is being played")
    print("cancelled: the tool is lifted")
    return 0
