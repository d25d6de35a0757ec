# SPDX-License-Identifier: Apache-2.0
"""One conversation with the controller's dashboard server (a line in, a line out), with time-outs.

Sources: Universal Robots, "Dashboard Server e-Series"; how long it takes: UR's Universal_Robots_Client_Library, pull
requests 126 (its greeting 1.5 s after the port opens, at the controller's start) and 414 (power on may take longer
still), and Universal_Robots_ROS2_Driver, pull request 1564 (a second of power off).
"""

import socket

from seed_driver.robot.link import LinkError

PORT = 29999
TIMEOUT = 0.5  # [s] to connect, and of the answer to a question
PATIENCE = 10.0  # [s] of the answer to a command that the robot carries out first
SLOW_COMMANDS = ("power on", "brake release", "unlock protective stop", "restart safety")
LOCAL_CONTROL = "in local control: switch it to remote control on the pendant"  # what a robot is, and the remedy


class NoDashboardError(LinkError):
    """Nobody is there: another computer, or PolyScope X."""


class LateError(LinkError):
    """It is there, and has not answered in time."""


def dashboard(host: str, *commands: str) -> str:
    """Send dashboard commands in turn.

    Returns:
        The answer to the last command, on one line.

    Raises:
        NoDashboardError: nobody is there.
        LateError: it takes too long.
    """
    timeout, connected = PATIENCE if set(SLOW_COMMANDS) & set(commands) else TIMEOUT, False
    try:
        with socket.create_connection((host, PORT), TIMEOUT) as connection, connection.makefile("rwb") as file:
            connected = True
            connection.settimeout(timeout)
            answer = file.readline()
            for command in commands:
                file.write(command.encode() + b"\n")
                file.flush()
                answer = file.readline()
    except OSError as error:
        if connected and isinstance(error, TimeoutError):
            words = f"the dashboard at {host}:{PORT} has not answered '{', '.join(commands)}' within {timeout:g} s"
            raise LateError(f"{words}: look at the pendant, then ask again") from error
        words = f"no dashboard at {host}:{PORT} ({error}); PolyScope X has none: use its screen"
        raise NoDashboardError(words) from error
    return " ".join(answer.decode("utf-8", "replace").split())
