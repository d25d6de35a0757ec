# SPDX-License-Identifier: Apache-2.0
"""The contract of a camera (docs/camera_contract.md), checked on running cameras or on a bag.

    ./seed shell -c 'python -m seed_testing.camera_contract'                # cameras that run, 10 s
    ./seed shell -c 'python -m seed_testing.camera_contract --bag FOLDER'   # a recording

Hold the hand still, with the membranes free or grasping. Prints a line per clause; exits with 1 when one is broken.
"""

import json
import sys
from pathlib import Path

from seed_core.errors import FailedError
from seed_core.hand import FINGERS_OF
from seed_core.program.command_line import Parser, command, number
from seed_estimation.images import identity
from seed_ros.images import BRIGHTNESS
from seed_testing.camera_clauses import Limits, check
from seed_testing.camera_observation import Observation

WORDS = {True: "kept  ", False: "BROKEN", None: "open  "}


@command("seed_testing.camera_contract")
def main(argv: list[str]) -> int:
    """Command line; 0 when every clause is kept, or left open by what is there."""
    default = Limits()
    p = Parser(prog="seed_testing.camera_contract", description=__doc__)
    p.add_argument("--bag", type=Path, help="check this recording instead of running cameras")
    p.add_argument("--seconds", type=number(1.0, "s", 3600.0), default=10.0, help="of listening; default: %(default)s")
    p.add_argument("--left", default="bubble_left", help="prefix of the left bubble's topics; default: %(default)s")
    p.add_argument("--right", default="bubble_right", help="of the right bubble's; default: %(default)s")
    p.add_argument("--brightness", default="ir", choices=BRIGHTNESS, help="default: %(default)s")
    p.add_argument("--fingers", default="both", choices=tuple(FINGERS_OF), help="default: %(default)s")
    p.add_argument("--rectified", action="store_true", help="streams are rectified: ignore D of camera_info")
    p.add_argument("--rate", type=number(1.0, "Hz", 200.0), default=default.rate, help="[Hz]; default: %(default)s")
    p.add_argument("--identity", type=Path, help="file that the estimator's identity_file has written")
    p.add_argument("--sim-time", action="store_true", help="stamps are of /clock")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    given = p.parse_args(argv)
    prefixes = {"left": given.left, "right": given.right}
    seen = Observation(
        {f: v for f, v in prefixes.items() if given.fingers in ("both", f)}, given.brightness, given.rectified
    )
    known = identity.load(given.identity) if given.identity else {}
    if given.bag:
        seen.read(given.bag)
    else:
        seen.listen(given.seconds, given.sim_time)
    if not any(stream.seen for stream in seen.streams.values()):
        topics = ", ".join(stream.topic for stream in seen.streams.values())
        raise FailedError(f"no images at all on {topics}: does the camera run in this domain, are these its topics?")
    verdicts = check(seen, default._replace(rate=given.rate, known=known))
    if given.json:
        print(json.dumps({"clauses": [{"clause": c, "kept": k, "found": f} for c, k, f in verdicts]}))
    else:
        for clause, kept, found in verdicts:
            print(f"{WORDS[kept]}  {clause:40s} {found}")
    return int(any(kept is False for _, kept, _ in verdicts))


if __name__ == "__main__":
    sys.exit(main())
