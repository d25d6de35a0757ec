# SPDX-License-Identifier: Apache-2.0
"""./seed foxglove: a running cell in Foxglove."""

from seed_bringup.commands.cells import cell_arguments, in_root, join
from seed_bringup.foxglove.offered import HOST, PORT
from seed_core.program.command_line import Parser, command, interrupts, leaving_at_once, whole
from seed_core.program.files import shared_path


@command("seed foxglove")
def main(argv: list[str]) -> int:
    """Forward until Ctrl-C."""
    p = Parser(
        prog="seed foxglove",
        description="Forward a running cell to Foxglove, on this computer alone. Open the connection that it prints\n"
        "(Foxglove WebSocket) and import the layout that it names. It may be started before the cell.",
    )
    p.add_argument(
        "--host", default=HOST, help="address to listen on; any other than loopback can be reached by others"
    )
    p.add_argument("--port", type=whole(0, 65535), default=PORT, help="to listen on; 0: any")
    p.add_argument(
        "--buttons",
        action="store_true",
        help="offer Reference, Grasp, Release, Enable and Play as services, too: any page that is open in a browser on "
        "this computer can press them; Stop and Cancel are always offered",
    )
    cell_arguments(p)
    options = p.parse_args(argv)
    join(options)
    with leaving_at_once("foxglove"):
        from seed_bringup.foxglove.ros.bridge import serve  # rclpy only from here on
    print(f"seed foxglove: the layout is {shared_path('seed_bringup', 'layouts') / 'cell.json'}", flush=True)
    with interrupts() as check:
        serve(options.host, options.port, in_root(options.namespace), options.buttons, check)
    return 0
