# SPDX-License-Identifier: Apache-2.0
"""./seed call and ./seed play: services and tasks of a running cell, also where there is no `ros2` command."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seed_bringup.demo.terminal import Bar
from seed_control.tasks import load_task
from seed_core.command_line import Help, command, leaving_at_once
from seed_core.errors import FailedError, SeedError

if TYPE_CHECKING:
    from seed_bringup.ros.session import Session

DISCOVERY = 5.0  # [s] until every service of a running graph is known, as a rule
PATIENCE = 15.0  # [s] until one that is asked for is known, where packets are lost
TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"


@command("seed call")
def call(argv: list[str]) -> int:
    """Call one service, or list those there are."""
    p = argparse.ArgumentParser(prog="seed call", description="Call a service of a running cell.", formatter_class=Help)
    p.add_argument("service", nargs="?", help="for instance estimator/capture_reference; without it all are listed")
    p.add_argument("value", nargs="?", choices=("on", "off"), help="for services that switch, as controller/enable")
    options = p.parse_args(argv)
    session = _session("call", follow=False)
    try:
        if options.service is None:
            session.spin(DISCOVERY)
            print("\n".join(f"{n}{' on|off' if k == SET_BOOL else ''}" for n, k in sorted(_services(session).items())))
        else:
            print(_call(session, "/" + options.service.lstrip("/"), options.value))
    finally:
        session.close()
    return 0


def _services(session: Session) -> dict[str, str]:
    """Name and type of what can be called."""
    found = session.node.get_service_names_and_types()
    return {name: kinds[0] for name, kinds in found if kinds[0] in (TRIGGER, SET_BOOL)}


def _call(session: Session, name: str, value: str | None) -> str:
    session.until(lambda: name in _services(session), PATIENCE, "")
    kind = _services(session).get(name)
    if kind is None:
        raise FailedError(f"no service {name}: is the cell running? ./seed call lists what there is")
    if (kind == SET_BOOL) != (value is not None):
        raise SeedError(f"{name} {'switches: say on or off' if kind == SET_BOOL else 'takes neither on nor off'}")
    return (session.trigger(name) if value is None else session.switch(name, value == "on")) or "done"


@command("seed play")
def play(argv: list[str]) -> int:
    """Play a task to its end."""
    p = argparse.ArgumentParser(
        prog="seed play",
        description="Play a task on a running cell whose controller is enabled. Ctrl-C cancels it: the tool is lifted.",
        formatter_class=Help,
    )
    p.add_argument("task", help="name of a shipped task (squeegee, pen, write, torque_driver, peg) or a task file")
    p.add_argument("--force", type=float, help="[N] size of every force in the task; its own if left out")
    options = p.parse_args(argv)
    load_task(options.task, options.force)  # says here and now what is wrong with it
    file = Path(options.task)
    task = str(file.resolve()) if file.is_file() else options.task
    session, bar = _session("play", follow=True), Bar()

    def tell(feedback: Any) -> None:
        bar.show(feedback.phase, feedback.progress, session.pressing_force)

    try:
        overrides = "" if options.force is None else f"force: {options.force}"
        result = session.play(task, overrides, tell, patience=float("inf")).result
    except KeyboardInterrupt:
        print("\nseed play: cancelling; the tool is lifted", file=sys.stderr, flush=True)
        session.cancel()
        raise
    finally:
        bar.close()
        session.close()
    if not result.success:
        raise FailedError(result.message)
    print(f"done in {result.duration:.1f} s; estimated force within {result.force_rmse:.2f} N rms of what was wanted")
    return 0


def _session(name: str, follow: bool) -> Session:
    with leaving_at_once(name):
        from seed_bringup.ros.session import Session  # rclpy only from here on
    return Session(lambda: None, follow)
