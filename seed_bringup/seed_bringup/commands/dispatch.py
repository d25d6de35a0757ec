# SPDX-License-Identifier: Apache-2.0
"""The dispatcher behind ./seed, once the environment stands (also `ros2 run seed_bringup seed`)."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

from seed_bringup.command_table import available, usage
from seed_core.command_line import command, leaving_at_once

# Where an ordinary workspace lacks one of these, rosdep cannot help: module and its name on the package index.
PIP_ONLY = {
    "pydrake": "drake",
    "rosbags": "rosbags",
    "rtde_control": "ur-rtde",
    "rtde_receive": "ur-rtde",
    "dashboard_client": "ur-rtde",
}


@command("seed")
def main(arguments: list[str]) -> int:
    """Run one subcommand and return its exit code."""
    root = os.environ.get("SEED_ROOT")
    commands = available(Path(root) if root else None)
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage(commands))
        return 0
    chosen = commands.get(arguments[0])
    if chosen is None:
        print(f"seed: no command {arguments[0]!r}; there are: {', '.join(commands)}", file=sys.stderr)
        return 2
    return _run(chosen.module, chosen.function, arguments)


def _run(module: str, function: str, arguments: list[str]) -> int:
    sys.argv = [f"seed {arguments[0]}", *arguments[1:]]
    try:
        with leaving_at_once(arguments[0]):
            run = getattr(importlib.import_module(module), function)
        return int(run(arguments[1:]))
    except ModuleNotFoundError as error:
        package = PIP_ONLY.get((error.name or "").partition(".")[0])
        if package is None:
            raise
        message = f"needs the Python package {package}, which apt does not have: pip install {package}"
        print(f"seed {arguments[0]}: {message} (the version in requirements/)", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
