# SPDX-License-Identifier: Apache-2.0
"""./seed capture: makes what ./seed calibrate reads, from the images of running cameras.

Step by step: the membranes free, then a cylinder of known radius held in three to five poses. Each step is looked
at while you hold still and judged by what the calibration will make of it; what is of no use is not taken.
Then:  ./seed calibrate CAPTURE.npz --out calibration.yaml
"""

import argparse
import os
import select
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np

from seed_bringup.commands.cells import cell_arguments, join
from seed_bringup.ros.practice import Practice
from seed_bringup.ros.session import Session
from seed_bringup.ros.tactile_streams import Frame, TactileStreams
from seed_core.config import load_file
from seed_core.errors import FailedError, SeedError
from seed_core.hand import Hand, read_hand
from seed_core.program.command_line import Parser, command, interrupts, number, whole
from seed_estimation.calibration.calibrate import MembraneShape
from seed_estimation.calibration.capture import LEAST_POSES, MOST_POSES, Capture
from seed_ros.images import BRIGHTNESS

FIRST = 15.0  # [s] for the first images
PATIENCE = 30.0  # [s] for all images of a step
MOST_PAUSES = 5  # of the cameras in a row, after which they are given up
LOOK = 0.4  # [s] between two looks at what the cameras see
TILTS = (
    "upright",
    "tilted by 10 degrees towards one side of the hand",
    "tilted by 10 degrees towards the other side",
    "turned by 20 degrees in the plane of the membranes",
    "turned by 20 degrees the other way",
)
Ask = Callable[[str], str]  # a prompt to what was answered


class Guide:
    """Leads through a capture of running cameras."""

    def __init__(self, session: Session, streams: TactileStreams, capture: Capture, ask: Ask | None = None) -> None:
        """ask: how the person is asked; by default in the terminal, with what the cameras see beside it."""
        self._session, self._streams, self._capture = session, streams, capture
        self._ask = ask or self._ask_in_terminal
        self._pauses = 0  # of the cameras, one after the other

    def run(self, frames: int, per_pose: int, begin: Callable[[int], None] = lambda _: None) -> None:
        """All steps; `begin` is called with the number of each. Raises FailedError: the images end for good.

        What was taken before a pause of the cameras stays: the step is asked for again.
        """
        begin(0)
        self._step(
            "Step 1: nothing touches the membranes, and the gripper is open.",
            frames,
            self._capture.free,
        )
        while self._capture.poses < MOST_POSES:
            k = self._capture.poses
            enough = k >= LEAST_POSES
            begin(k + 1)
            prompt = f"Step {k + 2}: grasp the cylinder firmly, {TILTS[k]}; then let go of it."
            if not self._step(prompt, per_pose, self._capture.pose, optional=enough):
                break

    def _step(self, prompt: str, count: int, use: Callable[[list[Frame]], str], optional: bool = False) -> bool:
        """Take one step until it succeeds; whether it was taken."""
        keys = "Enter to take it, f and Enter to finish" if optional else "Enter to take it"
        while True:
            if self._ask(f"{prompt}  [{keys}]").strip().lower() == "f" and optional:
                return False
            try:
                got = self._gather(count)
                self._pauses = 0
                print(f"  taken: {use(got)}", flush=True)
            except FailedError as error:
                print(f"  not taken: {error}", flush=True)
                if self._pauses > MOST_PAUSES:
                    raise
            else:
                return True

    def _gather(self, count: int) -> list[Frame]:
        """The next frames. Raises FailedError: they do not come."""
        got: list[Frame] = []
        self._streams.use = got.append
        self._session.until(lambda: len(got) >= count, PATIENCE, "")
        self._streams.use = lambda _: None
        if len(got) < count:
            self._pauses += 1
            why = self._streams.problem or "do the cameras still run?"
            raise FailedError(f"{len(got)} of {count} images within {PATIENCE:g} s: {why}")
        return got[:count]

    def _ask_in_terminal(self, prompt: str) -> str:
        """What is typed; what the cameras see is shown meanwhile."""
        print(prompt, flush=True)
        live = sys.stdout.isatty()
        while not select.select([0], [], [], 0.0)[0]:
            self._session.spin(LOOK)
            if live:
                print(f"\r\033[K  {self._seen()}", end="", flush=True)
        if live:
            print("\r\033[K", end="")
        typed = os.read(0, 1000)
        if not typed:
            raise FailedError("the input has ended before the capture was complete")
        return typed.decode(errors="replace")

    def _seen(self) -> str:
        frames = list(self._streams.recent)
        if self._streams.problem or len(frames) < 2:
            return self._streams.problem or "no images"
        looks = self._capture.look(frames)
        return "; ".join(f"{f}: {look.problem() or look}" for f, look in looks.items())[:150]


def wait_for_images(session: Session, streams: TactileStreams) -> None:
    """Until every stream has come. Raises FailedError: which has not."""
    session.until(lambda: not streams.missing and bool(streams.recent), FIRST, "")
    if streams.missing:
        raise FailedError(
            f"nothing on {', '.join(streams.missing.values())} within {FIRST:g} s: do the cameras run in this ROS "
            "domain, and are their topics called so (--left, --right, --brightness)?"
        )
    if not streams.recent:
        raise FailedError(streams.problem or "images of left and right never came within 25 ms of each other")


def try_to_write(out: Path) -> None:
    """Raises SeedError: the file could not be written at the end."""
    there = out.exists()
    try:
        out.open("ab").close()
        tempfile.TemporaryFile(dir=out.absolute().parent).close()  # it is written beside, and takes its place
    except OSError as error:
        raise SeedError(f"{out} cannot be written: {error.strerror}; name another file with --out") from error
    if not there:
        out.unlink()


def save(capture: Capture, out: Path) -> None:
    """Write it; where that fails, somewhere else, for it took a person a quarter of an hour. Raises FailedError."""
    try:
        capture.save(out)
    except OSError as error:
        folder = Path(tempfile.mkdtemp(prefix="seed-capture-"))
        capture.save(folder / out.name)
        raise FailedError(f"{out}: {error.strerror}; the capture is in {folder / out.name}") from error


@command("seed capture")
def main(argv: list[str]) -> int:
    """Guide through a capture and write it."""
    options = _parser().parse_args(argv)
    if options.out.exists() and not options.force:
        raise SeedError(f"{options.out} exists: name another file with --out, or say --force")
    try_to_write(options.out)
    shape = load_file(options.membrane, MembraneShape) if options.membrane else MembraneShape()
    hand = read_hand(options.hand, alone=True)[0] if options.hand else Hand()
    with ExitStack() as stack:
        if options.practice:
            stack.enter_context(Practice.domain())
        else:
            join(options)
        check = stack.enter_context(interrupts())
        session = stack.enter_context(closing(Session(check, follow=False, namespace=options.namespace)))
        hands = stack.enter_context(closing(Practice(session))) if options.practice else None
        prefixes = {"left": options.left, "right": options.right}
        streams = TactileStreams(session.node, prefixes, options.brightness, options.rectified)
        wait_for_images(session, streams)
        first = next(iter(streams.recent[-1].values()))
        capture = Capture(streams.cameras, hand, shape, options.radius, options.full or streams.full)
        guide = Guide(session, streams, capture, hands.ask if hands else None)
        frames = options.frames or (60 if np.size(first.depth) > 100_000 else 150)
        guide.run(frames, options.per_pose, hands.begin if hands else lambda _: None)
    save(capture, options.out)
    also = "".join(f" --{name} {getattr(options, name)}" for name in ("membrane", "hand") if getattr(options, name))
    print(f"written to {options.out}; now: ./seed calibrate {options.out} --radius {options.radius:g}{also}")
    return 0


def _parser() -> argparse.ArgumentParser:
    p = Parser(prog="seed capture", description=__doc__)
    p.add_argument("--out", type=Path, default=Path("capture.npz"), help="file to write; default: %(default)s")
    p.add_argument("--left", default="bubble_left", help="prefix of the left bubble's topics; default: %(default)s")
    p.add_argument("--right", default="bubble_right", help="of the right bubble's; default: %(default)s")
    p.add_argument("--brightness", default="ir", choices=BRIGHTNESS, help="default: %(default)s")
    p.add_argument("--rectified", action="store_true", help="streams are rectified: ignore D of camera_info")
    p.add_argument("--membrane", type=Path, help="YAML of the membrane's shape: rim_x, rim_y, height, apex")
    p.add_argument("--hand", help="the launch's hand_file, or YAML of the hand alone")
    p.add_argument(
        "--radius", type=number(0.003, "m", 0.05), default=0.012, help="[m] of the cylinder; default: %(default)s"
    )
    p.add_argument(
        "--full",
        type=number(1.0, "counts"),
        default=0.0,
        help="of a full pixel; default: 255 or 65535, by the encoding",
    )
    p.add_argument(
        "--frames", type=whole(8, 1000), default=0, help="of the free membranes; default: 150, or 60 of large images"
    )
    p.add_argument("--per-pose", type=whole(4, 200), default=20, help="images of each pose; default: %(default)s")
    p.add_argument(
        "--practice", action="store_true", help="simulated cameras and hands, which hold still by themselves"
    )
    p.add_argument("--force", action="store_true", help="write over an existing file")
    cell_arguments(p)
    return p
