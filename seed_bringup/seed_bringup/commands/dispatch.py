# SPDX-License-Identifier: Apache-2.0
"""The dispatcher behind ./seed, once the environment stands (also `ros2 run seed_bringup seed`)."""

import importlib
import os
import signal
import sys

from seed_bringup.command_table import offered, usage
from seed_core.program.command_line import command, leaving_at_once
from seed_core.program.suggestions import did_you_mean

# Where an ordinary workspace lacks one of these, rosdep cannot help: module and its name on the package index.
PIP_ONLY = {
    "foxglove": "foxglove-sdk",
    "gymnasium": "gymnasium",
    "pydrake": "drake",
    "rosbags": "rosbags",
    "rtde_control": "ur-rtde",
    "rtde_receive": "ur-rtde",
    "dashboard_client": "ur-rtde",
    "viser": "viser",
}


@command("seed")
def main(arguments: list[str]) -> int:
    """Run one subcommand and return its exit code."""
    commands = offered(checkout=bool(os.environ.get("SEED_ROOT")))
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage(commands))
        return 0
    name, *argv = arguments
    if name not in commands:
        meant = did_you_mean(name, commands)
        print(f"seed: no command {name!r}; there are: {', '.join(commands)}{meant}", file=sys.stderr)
        return 2
    sys.argv = [f"seed {name}", *argv]
    try:
        with leaving_at_once(name):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # it has waited since tools/bootstrap
            run = getattr(importlib.import_module(commands[name].module), commands[name].function)
        return int(run(argv))
    except ModuleNotFoundError as error:
        print(f"seed {name}: {_remedy(error)}", file=sys.stderr)
        return 1


def _remedy(error: ModuleNotFoundError) -> str:
    """What to install; the error itself where it is a mistake of ours."""
    missing = error.name or ""
    if missing.partition(".")[0] in PIP_ONLY:
        package = PIP_ONLY[missing.partition(".")[0]]
        install = f"pip install -c requirements/common.txt {package}, in a venv made with --system-site-packages"
        return f"needs the Python package {package}, which apt does not have: {install}"
    if missing.startswith("seed_") and "." not in missing:
        return f"needs the package {missing} of this suite: colcon build --packages-up-to {missing}"
    raise error


if __name__ == "__main__":
    sys.exit(main())
