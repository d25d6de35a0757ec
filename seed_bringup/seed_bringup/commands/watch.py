# SPDX-License-Identifier: Apache-2.0
"""./seed watch: a topic of a running cell in readable form, also where there is no `ros2` command."""

from contextlib import closing

from seed_bringup.commands.cells import cell_arguments, in_root, join, missing
from seed_core.errors import FailedError, SeedError
from seed_core.program.command_line import Parser, command, interrupts, leaving_at_once, number

DISCOVERY = 5.0  # [s] until every topic of a running graph is known, as a rule
PATIENCE = 15.0  # [s] until one that is asked for is known, where packets are lost


@command("seed watch")
def main(argv: list[str]) -> int:
    """Print one topic until Ctrl-C, or list those there are."""
    p = Parser(
        prog="seed watch",
        description="Print the newest message of a topic, now and then: lengths in m, angles in degrees.",
    )
    p.add_argument("topic", nargs="?", help="for instance relative_pose; without it all are listed")
    p.add_argument("--once", action="store_true", help="end after the first message")
    p.add_argument("--rate", type=number(0.01, "Hz", 100.0), default=2.0, help="[Hz] messages printed at most")
    p.add_argument(
        "--for", dest="patience", type=number(0.1, "s"), metavar="S", help="[s] after which it ends; 1 if nothing came"
    )
    cell_arguments(p)
    options = p.parse_args(argv)
    join(options)
    with leaving_at_once("watch"):
        from seed_bringup.ros.session import Session  # rclpy only from here on
        from seed_bringup.ros.watching import Watch, published
    with interrupts() as check, closing(Session(check, follow=False, namespace=options.namespace)) as session:
        if options.topic is None:
            session.spin(DISCOVERY)
            found = published(session.node)
            if not found:
                raise SeedError("there are no topics: no cell is running here, or it runs in another ROS_DOMAIN_ID")
            print("\n".join(f"{name}  ({kind})" for name, kind in found.items()))
            return 0
        absolute = options.topic.startswith("/") or not options.namespace
        name = "/" + options.topic.lstrip("/") if absolute else f"{in_root(options.namespace)}/{options.topic}"
        session.find(lambda: name in published(session.node), min(PATIENCE, options.patience or PATIENCE))
        if name not in (found := published(session.node)):
            raise SeedError(missing(f"nobody publishes {name}", name, found, "./seed watch"))
        watch = Watch(session.node, name, published(session.node)[name], options.rate, options.once)
        session.until(lambda: watch.over, options.patience or 1e9, "")
        if not watch.count:
            raise FailedError(f"no message came on {name}, though it is published")
    return 0
