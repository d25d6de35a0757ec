# SPDX-License-Identifier: Apache-2.0
"""Episodes of a bag: each stretch in which a set-point was followed, evenly sampled by when messages came."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_bringup.bags import BagError
from seed_bringup.bags.files import check_versions, messages_of, open_bag
from seed_bringup.bags.types import InstalledTypes
from seed_bringup.dataset.episode import LEAST, Episode, Frames, three_colours
from seed_bringup.dataset.following import Following
from seed_core.errors import SeedError
from seed_core.hand import FINGERS
from seed_ros.conversions import MessageError, pose_to_matrix, wrench_to_core
from seed_ros.images import pixels_from_message

# What is needed, in the order in which a frame takes it, and how it is read. Raise SeedError: not finite, no rotation.
_READ: dict[str, Callable[[Any], Any]] = {
    "current_pose": lambda m: pose_to_matrix(m.pose),
    "relative_pose": lambda m: pose_to_matrix(m.pose.pose),
    "wrench_estimate": lambda m: wrench_to_core(m.wrench),
    "controller/reference": lambda m: pose_to_matrix(m.pose),
    "controller/state": lambda m: wrench_to_core(m.desired, "desired"),
}
NEEDED = tuple(_READ)
AFTER_STATE = ("wrench_estimate", "controller/reference")  # the controller publishes them after its state
TASKS = "controller/follow_setpoints/_action/status"
PICTURES = {f"bubble_{side}/ir/image_rect_raw": side for side in FINGERS}
OLDEST, OLDEST_PICTURE = 0.2, 0.3  # [s] since what is newest of a stream came; beyond it a stretch ends
SHORTEST = 1.0  # [s]; what is shorter is no episode


def episodes_of(
    path: Path,
    fps: int,
    text: str,
    namespace: str = "",
    tell: Callable[[str], None] = lambda _: None,
    checked: Callable[[], None] = lambda: None,
) -> Iterator[Episode]:
    """The episodes of a bag in the order of time, one at a time in memory.

    Args:
        path: of the bag.
        fps: frames a second.
        text: the task in words.
        namespace: of the cell that was recorded.
        tell: is given, in words, what is left out.
        checked: is called at each message, and may raise.

    Raises:
        BagError: no readable bag, of another version, without what is needed, or nothing was asked of the controller.
    """
    types, kept = InstalledTypes(), _Kept(fps, text, tell)
    with open_bag(path) as reader:
        names = _streams(path, reader, types, namespace)
        chosen = [c for c in reader.connections if c.id in names]
        cut = _Cut(fps, {names[c.id] for c in chosen if names[c.id] in PICTURES and c.msgcount})
        for connection, stamp, data in messages_of(reader, chosen):
            checked()
            with _placed(where := f"{path}, {1e-9 * (stamp - reader.start_time):.1f} s into it"):
                yield from kept.of(cut.until(1e-9 * stamp), where)
                message = _decoded(types, data, connection.msgtype)
                if remark := cut.take(names[connection.id], message, 1e-9 * stamp):
                    tell(f"{where}: {connection.topic}: {remark}")
    yield from kept.of(cut.end(), f"{path}, at its end")
    if kept.shapes is None:
        late = f" in which {cut.late} went on" if cut.late else ""
        raise BagError(f"{path}: no set-point was followed for {SHORTEST:g} s{late}: nothing to learn from")


@contextmanager
def _placed(where: str) -> Iterator[None]:
    """Errors tell where they came. Raises BagError."""
    try:
        yield
    except SeedError as error:
        raise BagError(f"{where}: {error}") from error


def _decoded(types: InstalledTypes, data: bytes, kind: str) -> Any:
    """A message. Raises BagError: it is damaged."""
    try:
        return types.deserialize_cdr(data, kind)
    except Exception as error:  # rosbags raises whatever it trips over
        raise BagError(f"damaged {kind}: {error}") from error


class _Kept:
    """Episodes of one kind: those with pictures of the size that the first has.

    Attributes:
        shapes: of the fields of the first; None before it.
    """

    def __init__(self, fps: int, text: str, tell: Callable[[str], None]) -> None:
        self.shapes: dict[str, tuple[int, ...]] | None = None
        self._fps, self._text, self._tell = fps, text, tell

    def of(self, frames: Frames | None, where: str) -> Iterator[Episode]:
        """That of the frames, if it is one of them; where: the place in the bag at which it ends."""
        if frames is None:
            return
        episode = frames.episode(self._text, self._fps)
        shapes = {name: values.shape[1:] for name, values in episode.fields.items()}
        self.shapes = self.shapes or shapes
        if shapes == self.shapes:
            yield episode
        else:
            self._tell(f"{where}: the {len(episode)} frames before are left out: pictures of another size")


def check(path: Path, namespace: str = "") -> None:
    """Raises BagError: no readable bag, of another version, without what is needed, or with images of another kind."""
    types = InstalledTypes()
    with open_bag(path) as reader:
        names = _streams(path, reader, types, namespace)
        for connection in reader.connections:
            if names.get(connection.id) not in PICTURES:
                continue
            for _, _, data in islice(messages_of(reader, [connection]), 1):
                try:
                    _pixels(types.deserialize_cdr(data, connection.msgtype))
                except BagError as error:
                    raise BagError(f"{path}: {connection.topic}: {error}") from error


def _streams(path: Path, reader: Any, types: InstalledTypes, namespace: str) -> dict[int, str]:
    """Names of what is read, by the number of the connection; their types are loaded."""
    root = f"/{namespace.strip('/')}/".replace("//", "/")
    names = {c.id: c.topic.removeprefix(root) for c in reader.connections if c.topic.startswith(root)}
    chosen = [c for c in reader.connections if names.get(c.id) in (*NEEDED, *PICTURES, TASKS)]
    if missing := [n for n in NEEDED if n not in {names[c.id] for c in chosen}]:
        raise BagError(f"{path} lacks {', '.join(root + m for m in missing)}: record with ./seed bag record --all")
    check_versions(path, chosen, types)
    for c in chosen:
        types.load(c.msgtype)
    return {c.id: names[c.id] for c in chosen}


class _Cut:
    """Samples what is newest at even times, and cuts where no set-point is followed or a stream has stopped.

    Attributes:
        late: the stream that had stopped last while a set-point was followed, or ''.
    """

    def __init__(self, fps: int, pictures: set[str]) -> None:
        self._following = Following()
        self._fps, self._frames, self._start, self._count = fps, Frames(), 0.0, 0
        self._oldest = dict.fromkeys(NEEDED, OLDEST) | dict.fromkeys(pictures, OLDEST_PICTURE)
        self._pictures, self._newest, self._came, self.late = pictures, dict[str, Any](), dict[str, float](), ""
        self._resized, self._doubted = False, set[str]()

    def take(self, name: str, message: Any, t: float) -> str:
        """A message that came at t [s]; what is to be told of it, once."""
        if name in ("controller/state", "controller/reference", TASKS):
            before = self._following.at(t)
            self._following.take(name, message, t)
            if name == "controller/state" and not before and self._following.at(t):
                for old in AFTER_STATE:  # of another set-point
                    self._came.pop(old, None)
        if name == TASKS or (name == "relative_pose" and not message.valid):  # it holds no pose
            return ""
        if name in PICTURES:
            last, size = self._newest.get(name, message), (message.height, message.width)
            self._newest[name], self._came[name] = message, t
            if (last.height, last.width) == size:
                return ""
            self._resized = True
            return f"{size[1]} x {size[0]} pixels, {last.width} x {last.height} before: an episode ends here"
        try:
            self._newest[name] = _READ[name](message)
        except SeedError as error:  # as if it had not come
            known = name in self._doubted
            self._doubted.add(name)
            return "" if known else f"left out, as are others like it: {error}"
        self._came[name] = t
        return ""

    def until(self, t: float) -> Frames | None:
        """All samples before t [s]; an episode that has ended by then."""
        followed = self._following.at(t)
        if late := [n for n, oldest in self._oldest.items() if t - self._came.get(n, -inf) > oldest]:
            self.late = late[0] if followed else self.late
        if late or not followed or self._resized:
            self._start, self._count, self._resized = t, 0, False
            return self.end()
        while self._start + self._count / self._fps < t:
            pictures = {PICTURES[p]: _pixels(self._newest[p]) for p in self._pictures}
            flange, grasp, load, tip, wanted = (self._newest[n] for n in NEEDED)
            self._frames.add(flange, grasp, load, tip, wanted, pictures)
            self._count += 1
        return None

    def end(self) -> Frames | None:
        """The stretch is over; itself, if it is long enough."""
        ended, self._frames = self._frames, Frames()
        return ended if len(ended) >= max(LEAST, SHORTEST * self._fps) else None


def _pixels(image: Any) -> NDArray[np.uint8]:
    """(H, W, 3) RGB. Raises BagError: an encoding that is not known, or sizes that contradict each other."""
    try:
        pixels = pixels_from_message(image, "images")
    except MessageError as error:
        raise BagError(str(error)) from error
    if pixels.ndim == 2:
        of_8_bits = pixels.dtype == np.uint8
        return np.repeat(pixels[..., None], 3, axis=2) if of_8_bits else three_colours(pixels.astype(float))
    out = pixels[..., 2::-1] if image.encoding.startswith("bgr") else pixels[..., :3]
    return np.ascontiguousarray(out, np.uint8)
