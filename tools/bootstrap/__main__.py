# SPDX-License-Identifier: Apache-2.0
"""Sets up what ./seed needs (environment, then workspace) and starts the command inside it.

Standard library only. When nothing changed since the last start, this costs a few hashes and one exec.
"""

import os
import signal
import sys
from pathlib import Path

signal.signal(signal.SIGINT, signal.SIG_DFL)  # until main() can answer it
ROOT = Path(__file__).resolve().parents[2]
OURS = ("seed_bringup/seed_bringup", "seed_core/seed_core/program")  # of their modules those without libraries
sys.path[:0] = [str(Path(__file__).resolve().parent), *(str(ROOT / folder) for folder in OURS)]

import command_table  # noqa: E402
from suggestions import did_you_mean  # noqa: E402

from environment import ready_environment  # noqa: E402
from progress import SetupError, UsageError, say  # noqa: E402
from system import offer_browser  # noqa: E402
from workspace import ready_workspace  # noqa: E402


def main(arguments: list[str]) -> int:
    """Answer help and mistakes at once; set up and run everything else."""
    known = command_table.offered(checkout=True)
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(command_table.usage(known))
        return 0
    if arguments[0] not in known:
        meant = did_you_mean(arguments[0], known)
        print(f"seed: no command {arguments[0]!r}; there are: {', '.join(known)}{meant}", file=sys.stderr)
        return 2
    # Also where a shell started us in the background with SIGINT ignored; exec gives the command the defaults again.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        start(arguments)
    except SetupError as error:
        say(str(error))
        return error.exit_code
    except KeyboardInterrupt:
        say("set-up interrupted; run the same command again and it starts over where it must")
        return 130
    return 0


def start(arguments: list[str]) -> None:
    """Replace this process by the command, inside the finished environment."""
    pins = _pins_asked_for(arguments)
    builds = arguments[0] == "build" and arguments[1:2] not in (["-h"], ["--help"])
    if builds and (wrong := [a for a in arguments[1:] if not a.startswith("-D")]):
        raise UsageError(f"build takes settings of CMake, -DNAME=VALUE, not {' '.join(wrong)}")
    environment = ready_environment(ROOT, pins)
    if arguments == ["test"]:  # every test
        offer_browser()
    variables = ready_workspace(ROOT, environment, rebuild=arguments[1:] if builds else None)
    python = str(environment.python)
    # Until the command's first libraries are there, nobody could answer Ctrl-C but with a traceback: it waits.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.execve(python, [python, "-P", "-m", "seed_bringup.commands.dispatch", *arguments], variables)


def _pins_asked_for(arguments: list[str]) -> str:
    """`test --pins apt` runs with the other set of pins."""
    if arguments[0] != "test" or "--pins" not in arguments:
        return ""
    at = arguments.index("--pins")
    pins = arguments[at + 1] if at + 1 < len(arguments) else ""
    if pins not in ("wheels", "apt"):
        raise UsageError(f"--pins {pins or '(nothing)'}: must be wheels or apt")
    del arguments[at : at + 2]
    return pins


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
