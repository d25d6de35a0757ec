# SPDX-License-Identifier: Apache-2.0
"""Images gathered for a service that waits for them: those of a no-contact reference, or of a new grasp."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from rclpy.task import Future

from seed_core.errors import SeedError
from seed_core.estimate import Regrasp, RelativePoseEstimate
from seed_estimation.images.tactile_images import TactileImages
from seed_ros import SeedNode

TIMEOUT = 6.0  # [s] without images of every finger, after which a reference or a grasp is given up
STARTING = 20.0  # [s] from the start of this node, in which the cameras may still be starting

Images = dict[str, TactileImages]  # by finger


class GatheringError(SeedError):
    """Images did not come, or cannot be used."""


@dataclass
class _Wanted:
    """What a service waits for, and its answer, which is given once poses may be used again."""

    what: str
    count: int
    use: Callable[[list[Images]], str]
    deadline: float  # [s] for the next images, by the machine's clock: a simulated one may stand still
    images: list[Images] = field(default_factory=list)
    outcome: tuple[bool, str] | None = None
    answer: Future = field(default_factory=Future)


class Gathering:
    """`add` all images and pass each estimate `through`; `watch` now and then."""

    def __init__(self, node: SeedNode) -> None:
        self._node = node
        self._started = time.monotonic()
        self._wanted: _Wanted | None = None
        self._regrasp = Regrasp()

    async def gather(self, what: str, count: int, use: Callable[[list[Images]], str]) -> str:
        """Wait for images and use them.

        Args:
            what: 'grasp' or 'reference'.
            count: images of every finger.
            use: gets the images and returns the answer; raises SeedError when they are of no use.

        Raises:
            GatheringError: with the reason.
        """
        if self._wanted is not None:
            raise GatheringError(f"still gathering images for the {self._wanted.what}")
        self._wanted = wanted = _Wanted(what, count, use, time.monotonic() + TIMEOUT)
        self._regrasp.begin(what)  # already now: a controller that presses has to hold before T := C
        success, words = await wanted.answer
        self._node.tell(success, f"{what}: {words}")
        if not success:
            raise GatheringError(words)
        return str(words)

    def add(self, images: Images) -> bool:
        """Keep the images of every finger for the service that waits; whether these were the last."""
        wanted = self._wanted
        if wanted is None or wanted.outcome is not None:
            return False
        wanted.images.append(images)
        wanted.deadline = time.monotonic() + TIMEOUT
        if len(wanted.images) < wanted.count:
            return False
        try:
            self._finish(wanted, True, wanted.use(wanted.images))
        except SeedError as error:
            self._finish(wanted, False, str(error))
        return True

    def through(self, estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        """What to publish in place of an estimate."""
        passed = self._regrasp.through(estimate)
        if not self._regrasp.under_way:
            self._give_answer()
        return passed

    def watch(self) -> None:
        """Give up on images that do not come."""
        wanted = self._wanted
        if wanted is None or time.monotonic() <= wanted.deadline:
            return
        if wanted.outcome is None:
            why = self._node.counters.last or "no images arrive"
            came = f"{len(wanted.images)} of {wanted.count} images came, none for {TIMEOUT:g} s"
            young = time.monotonic() - self._started < STARTING and not wanted.images
            started = "; a cell that has only just started needs some seconds: call again" if young else ""
            self._finish(wanted, False, f"{came}; {why}{started}")
        self._give_answer()  # no pose may come any more

    def _finish(self, wanted: _Wanted, success: bool, words: str) -> None:
        """The images are there, or never will be; the answer waits until a controller may be enabled on the poses."""
        wanted.outcome = success, words
        self._regrasp.end()

    def _give_answer(self) -> None:
        if self._wanted is not None and self._wanted.outcome is not None:
            self._wanted.answer.set_result(self._wanted.outcome)
            self._wanted = None
