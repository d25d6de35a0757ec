# SPDX-License-Identifier: Apache-2.0
"""Episodes of a bag: each stretch in which a set-point was followed, evenly sampled by when messages came."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_bringup.bags import BagError
from seed_bringup.bags.files import messages_of, open_bag
from seed_bringup.bags.types import InstalledTypes
from seed_bringup.dataset.episode import LEAST, Episode, Frames, eight_bits
from seed_core.arm.quaternion import to_pose
from seed_core.spatial import Array, Wrench

NEEDED = ("current_pose", "relative_pose", "wrench_estimate", "controller/state", "controller/reference")
PICTURES = {f"bubble_{side}/ir/image_rect_raw": side for side in ("left", "right")}
SHORTEST = 1.0  # [s]; what is shorter is no episode


def episodes_of(path: Path, fps: int, text: str, namespace: str = "") -> list[Episode]:
    """The episodes of a bag in the order of time.

    Raises:
        BagError: no readable bag, of another version, without what is needed, or nothing was asked of the controller.
    """
    root = f"/{namespace.strip('/')}/".replace("//", "/")
    types, newest, cut = InstalledTypes(), dict[str, Any](), _Cut(fps)
    with open_bag(path) as reader:
        names = {c.id: c.topic.removeprefix(root) for c in reader.connections if c.topic.startswith(root)}
        chosen = [c for c in reader.connections if names.get(c.id) in (*NEEDED, *PICTURES)]
        if missing := [n for n in NEEDED if n not in {names[c.id] for c in chosen}]:
            raise BagError(f"{path} lacks {', '.join(root + m for m in missing)}: record with ./seed bag record --all")
        for c in chosen:
            if c.digest and c.digest != types.hash(c.msgtype):
                raise BagError(
                    f"{path}: {c.topic} was recorded with another version of {c.msgtype} than is installed here: "
                    "read the bag with that version of the suite"
                )
            types.load(c.msgtype)
        pictures = {names[c.id] for c in chosen if names[c.id] in PICTURES and c.msgcount}
        for connection, stamp, data in messages_of(reader, chosen):
            cut.until(1e-9 * stamp, newest, pictures)
            newest[names[connection.id]] = types.deserialize_cdr(data, connection.msgtype)
    cut.end()
    found = [frames.episode(text, fps) for frames in cut.done if len(frames) >= max(LEAST, SHORTEST * fps)]
    if not found:
        raise BagError(f"{path}: no set-point was followed for {SHORTEST:g} s: nothing to learn from")
    return found


class _Cut:
    """Samples what is newest at even times, and cuts where no set-point is followed."""

    def __init__(self, fps: int) -> None:
        self.done: list[Frames] = []
        self._fps, self._frames, self._start, self._count = fps, Frames(), 0.0, 0

    def until(self, t: float, newest: dict[str, Any], pictures: set[str]) -> None:
        """All samples before t [s]."""
        state = newest.get("controller/state")
        followed = state is not None and state.enabled and state.setpoint_kind == "hybrid"
        if not followed or not set(newest) >= {*NEEDED, *pictures}:
            self.end()
            self._start, self._count = t, 0
            return
        while self._start + self._count / self._fps < t:
            self._frames.add(*_read(newest), {PICTURES[p]: _pixels(newest[p]) for p in pictures})
            self._count += 1

    def end(self) -> None:
        """The stretch is over."""
        if len(self._frames):
            self.done.append(self._frames)
            self._frames = Frames()


def _read(newest: dict[str, Any]) -> tuple[Array, Array, Wrench, Array, Wrench]:
    state = newest["controller/state"]
    return (
        _pose(newest["current_pose"].pose),
        _pose(newest["relative_pose"].pose.pose),
        _wrench(newest["wrench_estimate"].wrench),
        _pose(newest["controller/reference"].pose),
        _wrench(state.desired),
    )


def _pose(pose: Any) -> Array:
    q, p = pose.orientation, pose.position
    return to_pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def _wrench(w: Any) -> Wrench:
    return Wrench(np.array((w.torque.x, w.torque.y, w.torque.z)), np.array((w.force.x, w.force.y, w.force.z)))


def _pixels(image: Any) -> NDArray[np.uint8]:
    """(H, W, 3) RGB. Raises BagError: an encoding that is not known."""
    kinds = {"mono16": (np.uint16, 1), "mono8": (np.uint8, 1), "rgb8": (np.uint8, 3), "bgr8": (np.uint8, 3)}
    if image.encoding not in kinds:
        raise BagError(f"images are {image.encoding}; known: {', '.join(kinds)}")
    kind, channels = kinds[image.encoding]
    size = np.dtype(kind).itemsize * channels * image.width
    rows = np.frombuffer(bytes(image.data), np.uint8).reshape(image.height, image.step)[:, :size]
    pixels = np.ascontiguousarray(rows).view(np.dtype(kind).newbyteorder(">" if image.is_bigendian else "<"))
    pixels = pixels.reshape(image.height, image.width, channels)
    if image.encoding == "mono16":
        return eight_bits(pixels[..., 0].astype(float))
    out = pixels[..., ::-1] if image.encoding == "bgr8" else np.repeat(pixels, 3 // channels, axis=2)
    return np.ascontiguousarray(out, np.uint8)
