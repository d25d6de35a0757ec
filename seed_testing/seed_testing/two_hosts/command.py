# SPDX-License-Identifier: Apache-2.0
"""./seed bench hosts: a cell of two computers with a bad network between them.

Cameras and estimator run in one network namespace, controller and simulated arm in the other; only ROS crosses the
link, found by unicast discovery, as docs/network.md has it. Needs the rights of root.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

from seed_bringup.launching.addresses import listening_as
from seed_bringup.launching.domains import OWN, claimed
from seed_core.errors import FailedError
from seed_core.program.command_line import Parser, command
from seed_testing.live.verdict import EXCESS, HELD_WITHIN
from seed_testing.two_hosts.network import ADDRESSES, Quality, TwoHosts, why_not

CAMERA, ROBOT = 0, 1
WANTED = 10.0  # [N] that the task presses with
STANDS_WITHIN = 0.3  # [s] of a cut: the controller's time-out, a period of the camera, the way across, braking
TRAVEL = 15.0  # [mm] of that at the task's 50 mm/s


class Case(NamedTuple):
    """A row: name, the link, and by how much the camera computer's clock is ahead [s]."""

    name: str
    quality: Quality
    skew: float = 0.0
    does: str = "play"


CASES = (
    Case("no delay", Quality()),
    Case("2 ms", Quality(0.002)),
    Case("10 ms", Quality(0.010)),
    Case("30 ms", Quality(0.030)),
    Case("10 +- 5 ms", Quality(0.010, 0.005)),
    Case("2 ms, 1 % lost", Quality(0.002, 0.0, 0.01)),
    Case("2 ms, 5 % lost", Quality(0.002, 0.0, 0.05)),
    Case("2 ms, cut", Quality(0.002), 0.0, "cut"),
    Case("2 ms, clock +5 ms", Quality(0.002), 0.005),
    Case("2 ms, clock -5 ms", Quality(0.002), -0.005),
    Case("2 ms, clock +50 ms", Quality(0.002), 0.050),
    Case("2 ms, clock -50 ms", Quality(0.002), -0.050),
)
HEAD = f"{'link':<20} {'age ms':>7} {'p99':>6} {'skew ms':>14} {'rms N':>6} {'max N':>6}  how it ended"


def _parser() -> argparse.ArgumentParser:
    p = Parser(prog="seed bench hosts", description=__doc__)
    names = [c.name for c in CASES]
    p.add_argument("--cases", nargs="+", choices=names, default=names, metavar="CASE", help=f"of {', '.join(names)}")
    p.add_argument("--method", default="rigid_fit", choices=("rigid_fit", "truth"), help="truth: without images")
    p.add_argument(
        "--out",
        type=Path,
        default=Path("results/hosts.json"),
        help="file of rows; what was well with this method is not run again",
    )
    return p


@command("seed bench hosts")
def main(argv: list[str]) -> int:
    """Print the table as it grows; 1 when a case did not end as it should."""
    o = _parser().parse_args(argv)
    if why := why_not():
        raise FailedError(why)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # namespaces are taken down at either
    o.out.parent.mkdir(parents=True, exist_ok=True)
    rows: dict[str, Any] = json.loads(o.out.read_text(encoding="utf-8")) if o.out.is_file() else {}
    wanted = [c for c in CASES if c.name in o.cases]
    to_do = [c for c in wanted if wrong(c, of_method(rows, c, o.method))]
    print(HEAD, flush=True)
    for case in wanted:
        if case not in to_do:
            print(line(case, rows[case.name]), flush=True)
    with claimed(OWN, "seed bench hosts"):
        for skew in dict.fromkeys(c.skew for c in to_do):
            for case, row in run([c for c in to_do if c.skew == skew], skew, o.method, o.out):
                rows[case.name] = row | {"method": o.method, "load": round(os.getloadavg()[0], 1)}
                print(line(case, row), flush=True)
                o.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    bad = {c.name: why for c in wanted if (why := wrong(c, of_method(rows, c, o.method)))}
    print("\n".join(f"WRONG: {name}: {why}" for name, why in bad.items()) or f"all as it should be; {o.out}")
    return 1 if bad else 0


def of_method(rows: dict[str, Any], case: Case, method: str) -> dict[str, Any]:
    """The row of a case; empty where there is none that was made with this method."""
    row: dict[str, Any] = rows.get(case.name, {})
    return row if row.get("method") == method else {}


def wrong(case: Case, row: dict[str, Any]) -> str:
    """What is not as it should be; '' for nothing."""
    if not row:
        return "not run"
    if abs(case.skew) > 0.01:
        return "" if "the clock of the estimator's computer" in row["ended"] else "a clock that is off was accepted"
    if row["skew_ms"] == "" or abs(float(row["skew_ms"]) - 1e3 * case.skew) > float(row["within_ms"]) + 0.5:
        return f"the skew is {1e3 * case.skew:g} ms, measured as {row['skew_ms']} +- {row['within_ms']} ms"
    if case.does == "play":
        return str(row["ended"])
    if "hold" not in row:
        return row["ended"] or "it was not cut"
    if row["enable_while_cut"] == "granted":
        return "enabled without estimates"
    if not (isinstance(row["enabled_after_s"], float) and row["hold"]):
        return "no cause, or no way back"
    return _after_cut(row)


def _after_cut(row: dict[str, Any]) -> str:
    """What arm and force did that they should not, after a cut; what was not seen counts."""
    bounds = (
        ("held_after_s", STANDS_WITHIN, "stood after {} s, at most {:g} s"),
        ("blind_s", HELD_WITHIN, "not seen for {} s, at most {:g} s"),
        ("travel_mm", TRAVEL, "went on by {} mm, at most {:g} mm"),
        ("force_max_n", WANTED + EXCESS, "true force {} N, at most {:g} N"),
    )
    return "; ".join(words.format(row[k], most) for k, most, words in bounds if row[k] is None or not row[k] <= most)


def line(case: Case, row: dict[str, Any]) -> str:
    """A row for people."""
    skew = f"{row.get('skew_ms', '')} +- {row.get('within_ms', '')}"
    rms = "-" if row.get("force_rms_n") is None else f"{row['force_rms_n']:.2f}"
    words = row["ended"] or "done"
    if "hold" in row:
        words = (
            f"held {row['held_after_s']} s after the cut ({row['travel_mm']} mm): {row['hold']}; enable during it: "
            f"{row['enable_while_cut']}; enabled {row['enabled_after_s']} s after its end"
        )
    ages = f"{row['age_ms'] or '-':>7} {row['age_p99_ms'] or '-':>6}"
    return f"{case.name:<20} {ages} {skew:>14} {rms:>6} {row['force_max_n']:>6}  {words}"


def run(cases: Sequence[Case], skew: float, method: str, out: Path) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Rows of the cases with this skew, in one life of the cell."""
    with ExitStack() as stack:
        hosts = stack.enter_context(TwoHosts())
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="seed-hosts-"))
        seen = f"{folder}/world"
        camera, robot = (out.with_suffix(f".{name}.log") for name in ("camera", "robot"))
        addresses = ADDRESSES[CAMERA], ADDRESSES[ROBOT]
        stack.enter_context(_host(hosts, CAMERA, "camera_host", *addresses, seen, str(skew), method, str(camera)))
        told = stack.enter_context(_host(hosts, ROBOT, "robot_host", *addresses[::-1], seen, method, str(robot)))
        ready = _said(told, hosts)
        if "failed" in ready:
            raise FailedError(f"the cell of two computers was not ready: {ready['failed']}; see {camera} and {robot}")
        for case in cases:
            hosts.quality, lost = case.quality, hosts.lost
            assert told.stdin is not None
            print(case.does, file=told.stdin, flush=True)
            row = _said(told, hosts)
            hosts.quality = case.quality._replace(cut=False)
            yield case, row | {"packets_lost": hosts.lost - lost}
            hosts.quality = Quality()


def _said(process: "subprocess.Popen[str]", hosts: TwoHosts) -> dict[str, Any]:
    """The next row; what is said of the link before it is carried out."""
    out: IO[str] | None = process.stdout
    assert out is not None
    for words in out:
        said = json.loads(words) if words.startswith("{") else {"link": ""}
        if "link" not in said:
            return dict(said)
        if said["link"]:
            hosts.quality = hosts.quality._replace(cut=said["link"] == "cut")
    raise FailedError(f"the robot's computer ended with {process.wait()}")


@contextmanager
def _host(hosts: TwoHosts, which: int, module: str, *words: str) -> Iterator["subprocess.Popen[str]"]:
    """One of the two, until the context ends."""
    environment = os.environ | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_STATIC_PEERS": words[1],
        "SEED_ADDRESS": words[0],
        "SEED_LOOPBACK": "true",  # the launch files decide, as they do for ./seed
        **listening_as("hosts.xml"),
    }
    program = [sys.executable, "-P", "-m", f"seed_testing.two_hosts.ros.{module}", *words]
    process = subprocess.Popen(
        hosts.inside(which, program), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    try:
        with process:  # closes its input, at which it ends
            yield process
    finally:
        process.kill()
