# SPDX-License-Identifier: Apache-2.0
"""An episode as plain arrays, evenly sampled, and the folder in which episodes wait for the library."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_core.arm.quaternion import Quaternion, as_quaternion, continued
from seed_core.errors import FailedError, SeedError
from seed_core.hand import FINGERS
from seed_core.spatial import Array, Wrench
from seed_estimation.images.tactile_images import eight_bits

_XYZ, _QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
_POSE = (*_XYZ, *_QUATERNION)
_LOAD = (*(f"force_{a}" for a in _XYZ), *(f"torque_{a}" for a in _XYZ))
# Name of each number of the fields that are vectors: lengths [m], forces [N], torques [N m].
FIELDS: dict[str, tuple[str, ...]] = {
    # the flange in the base frame as reported, and the tool in the grasp, X_CT, as estimated
    "observation.state": (*(f"flange_{p}" for p in _POSE), *(f"grasp_{p}" for p in _POSE)),
    # of the tool on the environment about its tip, in the base frame, as estimated
    "observation.wrench": _LOAD,
    # the set-point: pose of the tip in the base frame, and the wrench in the task frame
    "action": (*(f"tip_{p}" for p in _POSE), *_LOAD),
}
IMAGES = {side: f"observation.images.{side}" for side in FINGERS}
LEAST = 2  # frames of an episode


@dataclass(frozen=True)
class Episode:
    """One episode of n frames.

    Attributes:
        task: in words. fps: frames a second.
        fields: by the names of FIELDS, (n, ...) float32, and of IMAGES, (n, H, W, 3) uint8.
    """

    task: str
    fps: int
    fields: Mapping[str, NDArray[Any]]

    def __post_init__(self) -> None:
        lengths = {name: len(values) for name, values in self.fields.items()}
        if set(lengths) - set(IMAGES.values()) != set(FIELDS) or len(set(lengths.values())) != 1:
            raise SeedError(f"an episode needs equally many frames of {', '.join(FIELDS)}, not {lengths}")
        if len(self) < LEAST:
            raise SeedError(f"an episode of {len(self)} frames is none: it needs {LEAST} at {self.fps} a second")
        for name, names in FIELDS.items():
            values = self.fields[name]
            if values.shape[1:] != (len(names),) or not np.isfinite(values).all():
                raise SeedError(f"{name} has shape {values.shape[1:]} or is not finite; it needs ({len(names)},)")

    def __len__(self) -> int:
        return len(self.fields["action"])

    @property
    def timestamps(self) -> Array:
        """(n,) [s] from the episode's start."""
        return np.asarray(np.arange(len(self)) / self.fps)


class Frames:
    """Frames of an episode as they come."""

    def __init__(self) -> None:
        self._rows: dict[str, list[NDArray[Any]]] = {}
        self._turned: dict[str, Quaternion] = {}  # of each pose in the frame before

    def __len__(self) -> int:
        return len(self._rows.get("action", ()))

    def add(
        self,
        flange: Array,
        grasp: Array,
        wrench: Wrench,
        tip: Array,
        wanted: Wrench,
        images: Mapping[str, NDArray[Any]],
    ) -> None:
        """One frame: poses (4, 4), loads, and images by side, (H, W, 3) uint8."""
        rows = {
            "observation.state": np.concatenate((self._pose("flange", flange), self._pose("grasp", grasp))),
            "observation.wrench": np.concatenate((wrench.force, wrench.torque)),
            "action": np.concatenate((self._pose("tip", tip), wanted.force, wanted.torque)),
        }
        for name, row in rows.items():
            self._rows.setdefault(name, []).append(row.astype(np.float32))
        for side, image in images.items():
            self._rows.setdefault(IMAGES[side], []).append(image)

    def episode(self, task: str, fps: int) -> Episode:
        """All of them. Raises SeedError: too few, or images are missing in some."""
        return Episode(task, fps, {name: np.stack(rows) for name, rows in self._rows.items()})

    def _pose(self, name: str, X: Array) -> Array:
        """(7,) position [m] and quaternion x y z w of a pose (4, 4), which goes on from the frame before."""
        q = self._turned[name] = continued(as_quaternion(X[:3, :3]), self._turned.get(name))
        return np.array((*X[:3, 3], *q))


def three_colours(infrared: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W, 3) of an infrared image (H, W) of 12 bits."""
    return np.repeat(eight_bits(infrared)[..., None], 3, axis=2)


def write_arrays(episodes: Iterable[Episode], folder: Path) -> dict[str, Any]:
    """Episodes as episode_000.npz and so on, with info.json: fps, names and shapes. Returns what that says.

    Each is written before the next is asked for, so that one at a time is in memory.

    Raises:
        SeedError: they are not of one kind, or there is none.
    """
    folder.mkdir(parents=True)
    fps, shapes, written = 0, dict[str, list[int]](), list[dict[str, Any]]()
    for e in episodes:
        these = {name: list(values.shape[1:]) for name, values in e.fields.items()}
        if written and (e.fps != fps or these != shapes):
            raise SeedError("the episodes differ in fields, sizes of images or rate: make a dataset of each kind")
        fps, shapes = e.fps, these
        columns: dict[str, Any] = {"timestamp": e.timestamps, **e.fields}
        np.savez_compressed(folder / f"episode_{len(written):03d}.npz", **columns)
        written.append({"task": e.task, "frames": len(e)})
    if not written:
        raise FailedError("no episode was finished")
    info = {
        "fps": fps,
        "fields": {name: {"shape": shape, "names": FIELDS.get(name)} for name, shape in shapes.items()},
        "episodes": written,
    }
    (folder / "info.json").write_text(json.dumps(info, indent=1) + "\n")
    return info
