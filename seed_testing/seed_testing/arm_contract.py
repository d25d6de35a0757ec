# SPDX-License-Identifier: Apache-2.0
"""The contract of an arm (docs/arm_contract.md), checked on any arm that is running.

    ./seed shell -c 'python -m seed_testing.arm_contract --arm driver'

Start the arm first (our driver, the simulated cell, a ros2_control robot with cartesian_controllers and an adapter)
and stand clear: it moves by up to 20 mm. Prints a line per clause, with its bound beside what was measured, and exits
with 1 unless every clause is kept. "open": this computer was too busy to tell.
"""

import json
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command
from seed_testing.contract_clauses import CLAUSES, Clause, Found, Limits
from seed_testing.peer import Peer

FIRST = 20.0  # [s] that its first pose may take
STARTING = 5.0  # [s] that an arm may take to be ready
OWN_PAUSE = 0.05  # [s] that this program may be late itself: half of an arm's time-out; beyond, no verdict against it
ATTEMPTS = 4  # at a clause that this program was late at
WORDS = {True: "kept  ", False: "BROKEN", None: "open  "}


class Verdict(NamedTuple):
    """One clause of the contract."""

    clause: str
    kept: bool | None  # None: this computer was too busy to tell
    found: str  # what was measured
    bound: str  # that it is held to; '' where nothing could be measured


def check(peer: Peer, limits: Limits, clauses: Sequence[Clause] = ()) -> list[Verdict]:
    """The clauses in turn, all when none is named; the arm ends where it began, within millimetres."""
    out = []
    for clause in clauses or CLAUSES:
        for _ in range(ATTEMPTS):
            peer.pause = 0.0
            try:
                enable(peer, limits)
                found = clause(peer, limits)
            except SeedError as error:
                found = Found(False, str(error), "")
            if found.kept or peer.pause < OWN_PAUSE:
                break
        out.append(_verdict(clause.__name__.replace("_", " "), found, peer.pause))
    return out


def _verdict(clause: str, found: Found, late: float) -> Verdict:
    """The clause is kept, or not, or open where this program was late [s] itself, and the arm is not to blame."""
    kept, measured, bound = found
    if kept or late < OWN_PAUSE:
        return Verdict(clause, kept, measured, bound)
    busy = f"this computer is too busy to tell: the check itself was late by {1e3 * late:.0f} ms"
    return Verdict(clause, None, f"{busy} (at most {1e3 * OWN_PAUSE:.0f} ms), {ATTEMPTS} times; {measured}", bound)


def line(verdict: Verdict) -> str:
    """A verdict as it is printed."""
    bound = f"  (bound: {verdict.bound})" if verdict.bound else ""
    return f"{WORDS[verdict.kept]}  {verdict.clause:45s} {verdict.found}{bound}"


def enable(peer: Peer, limits: Limits) -> None:
    """Let the arm rest, then ask it to follow again, as a user would."""
    peer.spin(0.5)
    peer.pose()
    if limits.enable:
        answer = peer.call(limits.enable)
        if not answer.success:
            raise SeedError(f"{limits.enable} refuses: {answer.message}")


def run(
    arm: str,
    limits: Limits,
    clauses: Sequence[Clause] = (),
    base: str = "base",
    current_pose: str = "current_pose",
    target_frame: str = "target_frame",
) -> list[Verdict]:
    """Join the graph and check the arm whose node is called `arm`, in all clauses when none is named."""
    with Peer(driver=arm, base=base, current_pose=current_pose, target_frame=target_frame) as peer:
        peer.wait(lambda: bool(peer.poses), FIRST, f"a first pose on {peer.pose_topic} (--current-pose names another)")
        ready, deadline = False, time.monotonic() + STARTING
        while not ready and time.monotonic() < deadline:  # whether it ever is, the clauses say
            with suppress(SeedError):
                enable(peer, limits)
                ready = True
        return check(peer, limits, clauses)


@command("seed_testing.arm_contract")
def main(argv: list[str]) -> int:
    """Command line; 0 when every clause is kept."""
    default = Limits()
    parser = Parser(prog="seed_testing.arm_contract", description=__doc__.split("\n")[0])
    parser.add_argument("--arm", default="driver", help="name of the arm's node (default %(default)s)")
    parser.add_argument("--base", default="base", help="name of the base frame (default %(default)s)")
    parser.add_argument("--enable", default=default.enable, help="its service that resumes motion; '' when it has none")
    parser.add_argument("--current-pose", metavar="TOPIC", default="current_pose", help="that the arm's pose comes on")
    parser.add_argument("--target-frame", metavar="TOPIC", default="target_frame", help="that takes the targets")
    parser.add_argument("--pose-rate", type=float, default=default.pose_rate, help="[Hz] (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args(argv)
    limits = default._replace(enable=given.enable, pose_rate=given.pose_rate)
    verdicts = run(given.arm, limits, (), given.base, given.current_pose, given.target_frame)
    if given.json:
        print(json.dumps({"arm": given.arm, "clauses": [v._asdict() for v in verdicts]}))
    else:
        for v in verdicts:
            print(line(v))
        if any(v.kept is None for v in verdicts):
            print("open clauses say nothing of the arm: repeat the check while nothing else runs here", file=sys.stderr)
    return 0 if all(v.kept for v in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
