# SPDX-License-Identifier: Apache-2.0
"""How every node of the suite starts and ends."""

from __future__ import annotations

import gc
import inspect
import os
import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from seed_core.errors import SeedError
from seed_ros.loop import FixedRateLoop


def run(create: Callable[[], Node], argv: list[str] | None = None) -> int:
    """Create a node, spin it (or its `loop`) until the end, and say in one line why it could not start.

    Returns the exit code.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        rclpy.init(args=argv)
    except RuntimeError as error:  # a file of parameters that cannot be read, a remapping that is none
        print(f"error: {error}", file=sys.stderr)
        return 1
    node: Node | None = None
    try:
        node = create()
        inspect.getframeinfo(sys._getframe())  # each logger's first line looks up all modules' files, 0.1 s: do it now
        gc.freeze()  # what was loaded so far stays: the collector need not walk it in a control loop
        loop = getattr(node, "loop", None)
        if isinstance(loop, FixedRateLoop):
            loop.run()
        else:
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # an interrupt in the middle of taking or publishing a message; RCLError is one
        if rclpy.ok():
            raise
    except SeedError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C comes twice below `ros2 launch`: the node is ending
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
