# SPDX-License-Identifier: Apache-2.0
"""./seed call: services of a running cell, also where there is no `ros2` command."""

from __future__ import annotations

import math
import time
from contextlib import closing
from typing import TYPE_CHECKING

from seed_bringup.commands.cells import await_start, cell_arguments, in_root, join, missing
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command, interrupts, leaving_at_once

if TYPE_CHECKING:
    from seed_bringup.ros.session import Session

DISCOVERY = 5.0  # [s] until every service of a running graph is known, as a rule
PATIENCE = 15.0  # [s] until one that is asked for is known, where packets are lost or its node still starts
TOGETHER = 3.0  # [s] within which the services of one node become known
TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"


@command("seed call")
def main(argv: list[str]) -> int:
    """Call one service, or list those there are."""
    p = Parser(
        prog="seed call",
        description="Call a service of a running cell.",
        epilog="Exit code: 0 when it is done; 1 when the node refuses, whose words are printed; 2 when it is used\n"
        "wrongly or nobody answers: no cell, no such service, no answer in time.",
    )
    p.add_argument("service", nargs="?", help="for instance estimator/capture_reference; without it all are listed")
    p.add_argument("value", nargs="?", choices=("on", "off"), help="for services that switch, as controller/enable")
    cell_arguments(p)
    options = p.parse_args(argv)
    join(options)
    with leaving_at_once("call"):
        from seed_bringup.ros.session import Session, SilenceError  # rclpy only from here on
    with interrupts() as check, closing(Session(check, follow=False, namespace=options.namespace)) as session:
        if options.service is None:
            session.spin(DISCOVERY)
            found = sorted(_services(session).items())
            if not found:
                raise SeedError("there are no services: no cell is running here, or it runs in another ROS_DOMAIN_ID")
            print("\n".join(f"{n}{' on|off' if k == SET_BOOL else ''}" for n, k in found))
        else:
            absolute = options.service.startswith("/") or not options.namespace
            name = "/" + options.service.lstrip("/") if absolute else f"{in_root(options.namespace)}/{options.service}"
            try:
                print(_call(session, name, options.value))
            except SilenceError as error:
                raise SeedError(str(error)) from error  # 2: nobody answers; 1 is a node's refusal
    return 0


def _services(session: Session) -> dict[str, str]:
    """Name and type of what can be called."""
    found = session.node.get_service_names_and_types()
    return {name: kinds[0] for name, kinds in found if kinds[0] in (TRIGGER, SET_BOOL)}


def _call(session: Session, name: str, value: str | None) -> str:
    node, seen = name.rpartition("/")[0], math.inf

    def over() -> bool:
        nonlocal seen
        known = _services(session)
        if any(n.rpartition("/")[0] == node for n in known):
            seen = min(seen, time.monotonic())
        return name in known or time.monotonic() - seen > TOGETHER

    await_start(session, over, "seed call")
    session.find(over, PATIENCE)
    kind = _services(session).get(name)
    if kind is None:
        raise SeedError(missing(f"there is no service {name}", name, _services(session), "./seed call"))
    if (kind == SET_BOOL) != (value is not None):
        raise SeedError(f"{name} {'switches: say on or off' if kind == SET_BOOL else 'takes neither on nor off'}")
    return (session.trigger(name) if value is None else session.switch(name, value == "on")) or "done"
