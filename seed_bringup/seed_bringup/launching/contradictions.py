# SPDX-License-Identifier: Apache-2.0
"""Launch arguments of our launch files that cannot be meant together."""

from collections.abc import Mapping

from seed_bringup.launching.addresses import is_standin
from seed_bringup.launching.launch_xml import LaunchError

SIMULATED = ("scenario", "task", "seed", "replay", "camera_rate", "camera_latency", "sim_rate")  # of that cell alone


def contradictions(given: Mapping[str, str], values: Mapping[str, str]) -> list[str]:
    """Which of the arguments that were given have no effect, in words.

    Args:
        given: by name, as they were given.
        values: of all variables once the launch file is resolved.

    Raises:
        LaunchError: with these arguments no cell can work.
    """
    robot, method = values.get("robot", ""), values.get("method", "")
    simulated = values.get("simulated", "True") == "True"
    arm = f"robot:={robot} robot_ip:={values['robot_ip']}" if robot == "ur" else f"robot:={robot}"
    if robot == "ur" and not values["robot_ip"]:
        raise LaunchError(
            "robot:=ur needs robot_ip:=ADDRESS of the UR controller, e.g. robot_ip:=192.168.56.101; "
            "robot_ip:=127.0.0.2 is the stand-in"
        )
    if robot == "ur" and values["robot_ip"].startswith("127.") and not is_standin(values["robot_ip"]):
        raise LaunchError(
            f"{arm} is no address: what begins with 127. is taken for the stand-in, e.g. robot_ip:=127.0.0.2; "
            "give a robot by its address"
        )
    if "base" in given and not given["base"]:
        raise LaunchError("base:= has no name: give that of the arm's base frame, or leave it out")
    if values.get("fingers", "both") != "both" and method == "published":
        raise LaunchError(f"fingers:={values['fingers']} with method:=published: that one needs both")
    if method == "truth" and not simulated:
        raise LaunchError(f"method:=truth with {arm}: only a simulation knows the true poses")
    unused = []
    cameras = given.get("cameras")
    if cameras and method in ("truth", "elsewhere"):
        unused.append(f"cameras:={cameras} with method:={method}: no camera is started for it")
    elif cameras and simulated and robot:
        unused.append(f"cameras:={cameras} with {arm}: its bubbles are simulated, too")
    if given.get("clocks") and robot == "sim":
        unused.append(f"clocks:={given['clocks']} with {arm}: a simulated cell has one clock")
    if not simulated:
        unused += [
            f"{name}:={given[name]} with {arm}: it is of the simulated cell" for name in SIMULATED if name in given
        ]
    return unused
