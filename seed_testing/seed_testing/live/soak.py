# SPDX-License-Identifier: Apache-2.0
"""./seed bench soak: tasks in a live cell for hours, recorded: does anything grow, is anything lost unsaid?

With --page the operator page is open all the while: somebody takes all that it sends, as a browser would.
"""

import argparse
import json
import math
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from seed_bringup.launching.domains import OWN, claimed
from seed_core.errors import FailedError
from seed_core.program.command_line import Parser, command, number
from seed_testing.live.soak_report import PICTURES, Samples, plot, summary, words

TASKS = ("squeegee",)


def _parser() -> argparse.ArgumentParser:
    p = Parser(prog="seed bench soak", description=__doc__)
    p.add_argument("--minutes", type=number(0.2, "min"), default=120.0, help="how long")
    p.add_argument("--every", type=number(0.5, "s"), default=10.0, help="[s] between two samples")
    p.add_argument("--method", default="rigid_fit", choices=("rigid_fit", "truth"), help="truth: without images")
    p.add_argument("--page", action="store_true", help="with the operator page open, though in no browser")
    p.add_argument("--out", type=Path, default=Path("results/soak"), help="folder for samples, summary and picture")
    p.add_argument(
        "robot", nargs="*", default=["robot:=sim"], metavar="NAME:=VALUE", help="launch arguments, as of seed demo"
    )
    return p


@command("seed bench soak")
def main(argv: list[str]) -> int:
    """Run, write samples.csv, summary.json and soak.png; 1 when something grew, or was lost unsaid."""
    o = _parser().parse_args(argv)
    o.out.mkdir(parents=True, exist_ok=True)
    page = {"view": "true", "view_port": "0"} if o.page else {}
    arguments = {"method": o.method, **page, **dict(word.split(":=", 1) for word in o.robot)}
    samples = Samples()
    ended = ""
    try:
        with claimed(OWN, "seed bench soak"):
            run(arguments, o.minutes, o.every, samples, o.out, o.page)
    except KeyboardInterrupt:
        ended = "ended by Ctrl-C"
    finally:
        result = summary(samples) | ({"ended": ended} if ended else {})
        samples.write(o.out / "samples.csv")
        (o.out / "summary.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        plot(samples, o.out / "soak.png")
        print("\n".join(words(result)))
    return 0 if result["verdict"] == "level" else 1


def run(arguments: dict[str, str], minutes: float, every: float, samples: Samples, out: Path, look: bool) -> None:
    """Play tasks for `minutes`; samples every `every` [s] go into `samples`; look: with the page open."""
    from seed_bringup.page.visitor import Visitor
    from seed_testing.live.ros.cell import Cell

    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="seed-soak-")))
        cell = stack.enter_context(Cell(arguments, log=out / "nodes.log", record=folder / "bag.mcap"))
        sampler = _Sampler(cell, samples, every)
        cell.also = sampler.look
        cell.prepare()
        if look:
            if not cell.page:
                raise FailedError("the cell has no page: leave out view:=false")
            sampler.visitor = stack.enter_context(Visitor(cell.page))
        end = time.monotonic() + 60.0 * minutes
        turn = 0
        while time.monotonic() < end:
            _play(cell, TASKS[turn % len(TASKS)], samples, end)
            turn += 1
        sampler.sample()
        samples.bag_mb = cell.bag_mb()


def _play(cell: Any, task: str, samples: Samples, end: float) -> None:
    """One task; a hold is noted, and what it asks for is done."""
    from seed_bringup.ros.session import SessionError

    try:
        cell.enable()
        played = cell.play(task, patience=min(600.0, max(end - time.monotonic(), 0.0) + 60.0))
        samples.tasks += 1
        if not played.result.success:
            samples.holds.append(played.result.message)
    except SessionError as error:
        samples.holds.append(str(error))
        if time.monotonic() < end:
            cell.recover()


class _Sampler:
    """Samples the cell now and then; `look` is called often."""

    def __init__(self, cell: Any, samples: Samples, every: float) -> None:
        self._cell, self._samples, self._every, self._next = cell, samples, every, -math.inf
        self.visitor: Any = None

    def look(self) -> None:
        """Sample when it is time."""
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + self._every
            self.sample()

    def sample(self) -> None:
        """Of every process, and what the nodes say of lost frames."""
        seen = {} if self.visitor is None else {PICTURES: float(self.visitor.pictures)}
        self._samples.add(time.monotonic(), self._cell.usage(), self._cell.figures() | seen)
