# SPDX-License-Identifier: Apache-2.0
"""Stand-in UR controller: lets any ur_rtde program run without a robot (docs/ur_controller.md)."""

import argparse
import ipaddress
import signal
import sys
from functools import partial
from math import radians

from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command, number
from seed_ur.models import MODELS
from seed_ur.standin.options import HOME, Options
from seed_ur.standin.server import Server
from seed_ur.standin.side_port import SideChannel


def loopback(host: str, anywhere: bool) -> str:
    """The address to bind; raises SeedError unless it is loopback or `anywhere` is set."""
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise SeedError(f"host = {host!r} must be an IP address such as 127.0.0.2") from error
    if not address.is_loopback and not anywhere:
        raise SeedError(f"host = {host} is not a loopback address; add --anywhere to serve other machines")
    return str(address)


def version(text: str) -> tuple[int, int, int, int]:
    """(major, minor, bugfix, build) from '5.12.4' or '5.12.4.1101319'."""
    try:
        numbers = [int(t) for t in text.split(".")]
    except ValueError:
        numbers = []
    if not 2 <= len(numbers) <= 4 or numbers[0] not in (3, 5, 10) or min(numbers) < 0:
        raise SeedError(f"version = {text!r} must be major.minor[.bugfix[.build]] with major 3, 5 or 10")
    bugfix, build = numbers[2:] + [0, 1101319][len(numbers) - 2 :]
    return numbers[0], numbers[1], bugfix, build


def parser() -> argparse.ArgumentParser:
    """Command line of the stand-in."""
    out = Parser(prog="seed ur-sim", description=__doc__)
    out.add_argument("--host", default="127.0.0.2", help="loopback address to serve on")
    out.add_argument("--model", default="ur5e", choices=sorted(MODELS), help="which arm")
    out.add_argument("--version", default="5.12.4.1101319", help="PolyScope version")
    out.add_argument("--home", type=float, nargs=6, metavar="DEG", help="joint angles at start [degree]")
    out.add_argument("--local", action="store_true", help="start in local control (remote control is refused)")
    out.add_argument(
        "--on-stop",
        default="paused",
        choices=("paused", "stopped", "playing"),
        help="state of the program after a stop",
    )
    out.add_argument("--unlock-after", type=number(0.0, "s"), default=5.0, help="[s] lock after a protective stop")
    out.add_argument("--protective-stop", action="store_true", help="start in a protective stop")
    out.add_argument("--await-plant", action="store_true", help="open the ports once a plant has placed the arm")
    out.add_argument("--anywhere", action="store_true", help="allow an address that other machines can reach")
    return out


@command("seed ur-sim")
def main(words: list[str]) -> int:
    """Serve until Ctrl-C or SIGTERM; as a node of a launch file it ends with 0 then, as all nodes do."""
    launched = "--ros-args" in words
    if launched:  # what a launch file adds: a name and parameters, of no use here
        words = words[: words.index("--ros-args")]
    given = parser().parse_args(words)
    home = tuple(radians(t) for t in given.home) if given.home else HOME
    options = Options(given.model, version(given.version), home, not given.local, given.on_stop, given.unlock_after)
    server = Server(loopback(given.host, given.anywhere), options, given.await_plant)
    server.open_side_port(partial(SideChannel, server))
    if given.protective_stop:
        server.robot.protective_stop()
    for ending in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ending, lambda *_: setattr(server, "running", False))
    print(f"UR stand-in: {given.model}, PolyScope {given.version}, on {given.host}", flush=True)
    server.run()
    if not launched:
        raise KeyboardInterrupt
    return 0


if __name__ == "__main__":
    sys.exit(main())
