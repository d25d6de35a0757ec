# SPDX-License-Identifier: Apache-2.0
"""./seed bag record|play|info: MCAP bags that `ros2 bag`, rosbags and Foxglove read."""

import argparse
import sys
import time
from pathlib import Path

from seed_bringup.commands.cells import cell_arguments, in_root, join
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command, number


@command("seed bag")
def main(argv: list[str]) -> int:
    """Run one of the three; ROS is imported by record and play only."""
    parser = Parser(prog="seed bag", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="record|play|info")
    _add_record(commands.add_parser("record", help="record topics until Ctrl-C"))
    _add_play(commands.add_parser("play", help="publish what a bag holds"))
    info = commands.add_parser("info", help="what a bag holds")
    info.add_argument("bag", type=Path, help="folder or .mcap file")
    info.set_defaults(run=_info)
    options = parser.parse_args(argv)
    options.run(options)
    return 0


def _add_record(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("topics", nargs="*", help="topics to record, now or when they appear")
    parser.add_argument("-a", "--all", action="store_true", help="every topic; feedback of actions is none")
    parser.add_argument("-o", "--output", type=Path, help="folder, or a name ending in .mcap for a single file")
    parser.add_argument("--use-sim-time", action="store_true", help="stamp by the cell's clock")
    parser.add_argument(
        "-d", "--duration", type=number(0.0, "s"), metavar="S", help="end so many seconds after the first message"
    )
    cell_arguments(parser)
    parser.set_defaults(run=_record)


def _add_play(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, help="folder or .mcap file")
    parser.add_argument("-r", "--rate", type=float, default=1.0, help="speed; 1 is as recorded")
    parser.add_argument("-l", "--loop", action="store_true", help="again and again, at most once a second")
    parser.add_argument("--clock", action="store_true", help="publish the cell's clock from the bag's times")
    parser.add_argument(
        "--delay",
        type=number(0.0, "s"),
        metavar="S",
        default=1.0,
        help="seconds before the first message; up to 3 more while nobody listens",
    )
    parser.add_argument("--topics", nargs="+", default=[], help="only these")
    parser.add_argument("-m", "--remap", nargs="+", default=[], metavar="FROM:=TO", help="publish under another name")
    cell_arguments(parser)
    parser.set_defaults(run=_play)


def _record(options: argparse.Namespace) -> None:
    from seed_bringup.bags.record import record

    if bool(options.topics) == options.all:
        raise SeedError("name the topics to record, or --all")
    path = options.output or Path(time.strftime("seed_bag_%Y_%m_%d-%H_%M_%S"))
    print(f"seed bag: recording {join(options)} to {path}; Ctrl-C ends it", flush=True)
    namespace = in_root(options.namespace)
    writer = record(path, options.topics, options.all, options.use_sim_time, options.duration, namespace)
    print(f"seed bag: {sum(writer.counts.values())} messages of {len(writer.counts)} topics in {path}")


def _play(options: argparse.Namespace) -> None:
    from seed_bringup.bags.play import play

    if any(":=" not in pair for pair in options.remap):
        raise SeedError(f"--remap takes FROM:=TO, not {' '.join(options.remap)}")
    remap = dict(pair.split(":=", 1) for pair in options.remap)
    print(f"seed bag: playing into {join(options)}", flush=True)
    played = play(
        options.bag,
        options.rate,
        options.clock,
        options.loop,
        options.delay,
        options.topics,
        remap,
        in_root(options.namespace),
    )
    print(f"seed bag: {played} messages played")


def _info(options: argparse.Namespace) -> None:
    from seed_bringup.bags.files import describe_bag

    print(describe_bag(options.bag))


if __name__ == "__main__":
    sys.exit(main())
