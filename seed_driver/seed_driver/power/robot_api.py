# SPDX-License-Identifier: Apache-2.0
"""Power, brakes and stops of either kind of controller: by the dashboard server, or PolyScope X's Robot API.

Source: Universal Robots, "Robot API" of PolyScope X 10.11: PUT .../robotstate/v1/state with an action, while the robot
is in remote mode. It may answer only when the action is done: UR's Universal_Robots_Client_Library waits 10 s for
brakes, and longer for power (its pull request 518). It was run against a stand-in for HTTP, never on a controller.
"""

import json
import socket
import time
from collections.abc import Callable
from http.client import HTTPConnection, HTTPException

from seed_driver.robot.dashboard import SLOW_COMMANDS, NoDashboardError, dashboard
from seed_driver.robot.link import LinkError

PORT = 80
PATH = "/universal-robots/robot-api/robotstate/v1/state"
TIMEOUT = 2.0  # [s] to connect
PATIENCE = {"POWER_ON": 60.0}  # [s] of an answer, by the action
USUAL_PATIENCE = 15.0  # [s] of any other
LOOK = 0.1  # [s] between two looks whether it is given up meanwhile
SWITCHING = 20.0  # [s] from power to brakes that may be released
FINAL = (400, 401, 403, 404, 405, 501)  # of HTTP's codes: not understood, not allowed, not there
ACTIONS = {command: command.upper().replace(" ", "_") for command in SLOW_COMMANDS}  # of the Robot API


class RefusedError(LinkError):
    """The Robot API is there, and does not do it; final: nor would it later, for the request itself is wrong."""

    def __init__(self, words: str, final: bool) -> None:
        super().__init__(words)
        self.final = final


def switch(host: str, *commands: str, said: str, pause: Callable[[float], None] = time.sleep) -> str:
    """Send the dashboard's commands in turn, to whichever of the two is there.

    Args:
        said: what the dashboard's answer to the last one contains when it is done.
        pause: between two attempts, and two looks for an answer [s]; a LinkError of it ends them.

    Returns:
        That answer, or what the Robot API has accepted.

    Raises:
        LinkError: neither is there, or it refuses.
    """
    try:
        answer = ""
        for i, command in enumerate(commands):  # one by one: no brake is released once it is given up
            if i:
                pause(0.0)
            answer = dashboard(host, command)
        if said not in answer.lower():
            raise LinkError(answer)
        return answer
    except NoDashboardError as error:
        nobody = str(error).partition(";")[0]
    done: list[str] = []
    for action in (ACTIONS[c] for c in commands if c in ACTIONS):
        if done:
            pause(0.0)
        until = time.monotonic() + (SWITCHING if done else 0.0)  # what comes after power has to wait for it
        while True:
            try:
                _put(host, action, nobody, pause)
                break
            except RefusedError as error:
                if error.final or time.monotonic() >= until:
                    raise
                pause(0.5)
        done.append(action)
    return f"{', '.join(done)}: accepted by the Robot API"


def _put(host: str, action: str, nobody: str, pause: Callable[[float], None]) -> None:
    """Ask for an action, with no proxy between us and the arm. Raises LinkError."""
    patience = PATIENCE.get(action, USUAL_PATIENCE)
    connection = HTTPConnection(host, PORT, timeout=TIMEOUT)
    try:
        connection.connect()
    except OSError as error:
        connection.close()
        raise LinkError(
            f"{nobody}, and no Robot API at {host}:{PORT} ({error}), which PolyScope X has from 10.11: use its screen"
        ) from error
    try:
        connection.request("PUT", PATH, json.dumps({"action": action}), {"Content-Type": "application/json"})
        _await_answer(connection.sock, patience, pause)
        answer = connection.getresponse()
        words = " ".join(answer.read(300).decode("utf-8", "replace").split())
    except TimeoutError as error:
        raise LinkError(
            f"the Robot API at {host}:{PORT} has not answered {action} within {patience:g} s: look at its screen"
        ) from error
    except (OSError, HTTPException) as error:
        raise LinkError(f"the Robot API at {host}:{PORT} breaks off {action} ({error}): use its screen") from error
    finally:
        connection.close()
    if (code := answer.status) >= 300:
        raise RefusedError(
            f"the Robot API refuses {action} (HTTP {code} {words}): is the robot in Automatic and Remote mode?",
            code in FINAL,
        )


def _await_answer(connection: socket.socket, patience: float, pause: Callable[[float], None]) -> None:
    """Until an answer begins. Raises TimeoutError: it does not within patience [s]."""
    until, usual = time.monotonic() + patience, connection.gettimeout()
    connection.settimeout(LOOK)
    while True:
        try:
            connection.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            pause(0.0)
            if time.monotonic() > until:
                raise
        else:
            connection.settimeout(usual)
            return
