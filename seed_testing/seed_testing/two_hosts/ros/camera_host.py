# SPDX-License-Identifier: Apache-2.0
"""The computer at the cameras: estimator and simulated cameras, with a clock of its own. Ends with its standard input.

python -m seed_testing.two_hosts.ros.camera_host ADDRESS PEER SOCKET SKEW METHOD LOG
"""

import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from seed_bringup.demo.live import live_rates
from seed_bringup.launching.description import Node, describe
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_testing.two_hosts.ros import skewed
from seed_testing.two_hosts.ros.world import TRUTH

SEEN = "world/relative_pose"  # what the cameras look at


def main() -> None:
    """Command line."""
    address, peer, socket, skew, method, log = sys.argv[1:]
    camera_rate, _ = live_rates()
    cell = describe(find_launch_file(["cell"]), {"camera_rate": str(camera_rate), "links": "false"})
    bubbles = next(n for n in cell.nodes if n.name == "bubbles")
    bubbles = replace(bubbles, remappings=(*bubbles.remappings, (TRUTH, SEEN)))
    world = ("-P", "-m", "seed_testing.two_hosts.ros.world", "receive", socket, skew)
    period = 1.0 / (camera_rate or 45.0)
    with ExitStack() as stack:
        file = stack.enter_context(Path(log).open("w", encoding="utf-8"))
        launch = Launch(
            find_launch_file(["camera_host"]),
            {"address": address, "peers": peer, "clocks": "simulated"},
            lambda label, line: print(f"[{label}] {line}", file=file, flush=True),
        )
        (estimator,) = launch.description.nodes
        world = ("-P", "-m", "seed_testing.two_hosts.ros.world", "receive", socket, skew)
        if method == "truth":
            nodes = [_module(estimator, (*world, "relative_pose", str(period)))]
        else:
            seen = _module(estimator, (*world, SEEN, "0.0"))
            nodes = [seen, _with_clock(estimator, skew), _with_clock(bubbles, skew)]
        launch.description.nodes = nodes
        stack.enter_context(launch)
        sys.stdin.read()


def _module(like: Node, words: tuple[str, ...]) -> Node:
    """A process with this Python, in the environment of that node."""
    program = Path(sys.executable)
    return replace(like, executable=program, name="", arguments=words, parameters=(), remappings=())


def _with_clock(node: Node, skew: str) -> Node:
    """That node, with a clock that is ahead by so many seconds."""
    words = ("-P", skewed.__file__, skew, str(node.executable), *node.arguments)
    return replace(node, executable=Path(sys.executable), arguments=words)


if __name__ == "__main__":
    main()
