# SPDX-License-Identifier: Apache-2.0
"""Listens to a running cell while the arm is led by hand, or while a task plays."""

import select
import sys
import termios
from collections.abc import Callable
from contextlib import closing
from functools import partial

from seed_msgs.msg import ControllerState, WrenchEstimate

from seed_bringup.ros.session import Session
from seed_bringup.teach.heard import STATE, WRENCH, Heard
from seed_core.errors import SeedError
from seed_ros.qos import QUEUE

FREEDRIVE = "driver/set_freedrive"


def heard_of(check: Callable[[], None], namespace: str, freedrive: bool, seconds: float) -> Heard:
    """What is shown until Enter is pressed, or for so long [s] if that is above 0.

    Args:
        check: is called often, and may raise.
        freedrive: let the arm be led, and hold it again afterwards.

    Raises:
        SeedError: nobody could press Enter here.
        SessionError: the arm does not go into freedrive.
    """
    if not seconds and not _at_terminal():
        raise SeedError("there is no terminal in which Enter could end it: say --seconds, such as --seconds 30")
    heard = Heard(led=freedrive)
    with closing(Session(check, follow=False, namespace=namespace)) as session:
        for name, kind in ((STATE, ControllerState), (WRENCH, WrenchEstimate)):
            session.node.create_subscription(kind, name, partial(heard.take, name), QUEUE)
        print(f"seed teach: listening to {session.arm()}", flush=True)
        try:
            if freedrive:
                print(f"seed teach: {session.switch(FREEDRIVE, True)}", flush=True)
            if seconds:
                session.spin(seconds)
            else:
                forget_typed()
                print("seed teach: show it now; press Enter when it is done", flush=True)
                session.until(lambda: bool(select.select([sys.stdin], [], [], 0.0)[0]), float("inf"), "")
        finally:
            if freedrive:
                print(f"seed teach: {session.switch(FREEDRIVE, False)}", flush=True)
    return heard


def _at_terminal() -> bool:
    return sys.stdin is not None and not sys.stdin.closed and sys.stdin.isatty()


def forget_typed() -> None:
    """What was typed into the terminal before is no answer."""
    termios.tcflush(sys.stdin, termios.TCIFLUSH)
