# SPDX-License-Identifier: Apache-2.0
"""One conversation with the controller's dashboard server (a line in, a line out), with time-outs.

Source: Universal Robots, "Dashboard Server e-Series".
"""

import socket

from seed_driver.robot.link import LinkError

PORT = 29999
TIMEOUT = 0.5  # [s]
LOCAL_CONTROL = "in local control: switch it to remote control on the pendant"  # what a robot is, and the remedy


class NoDashboardError(LinkError):
    """Nobody answers there: another computer, or PolyScope X."""


def dashboard(host: str, *commands: str, timeout: float = TIMEOUT) -> str:
    """Send dashboard commands in turn.

    Args:
        timeout: [s] of each answer.

    Returns:
        The answer to the last command, on one line.

    Raises:
        NoDashboardError: nobody answers.
    """
    try:
        with socket.create_connection((host, PORT), timeout) as connection, connection.makefile("rwb") as file:
            answer = file.readline()
            for command in commands:
                file.write(command.encode() + b"\n")
                file.flush()
                answer = file.readline()
    except OSError as error:
        words = f"no dashboard at {host}:{PORT} ({error}); PolyScope X has none: use its screen"
        raise NoDashboardError(words) from error
    return " ".join(answer.decode("utf-8", "replace").split())
