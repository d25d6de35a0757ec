# SPDX-License-Identifier: Apache-2.0
"""Identity of the bubbles: each one's printed dots are its fingerprint.

Motion alone cannot tell a bubble mounted upside down, or left from right. The dots of the no-contact reference,
normalised, are saved; an image is compared with its own, with its own turned by half a turn, and with the other's.
Names of optical frames and the cameras' intrinsics tell left from right as well, where they differ.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from seed_core.errors import SeedError
from seed_core.hand import FINGERS
from seed_core.program.npz import read_npz, write_npz
from seed_core.spatial import Array
from seed_estimation.images.normalise import normalised
from seed_estimation.images.tactile_images import Image

BLUR = 2.0  # [px] pressing moves the dots by some pixels; the pattern as a whole stays
SAME = 0.35  # correlation above which two patterns are one
MARGIN = 0.15  # by which another must fit better than the own
SAME_LENS = 0.05  # [px] intrinsics that differ by less are one camera's
MAX_BYTES = 50_000_000
FOREIGN = (
    "identity_file is damaged, or was not written by the estimator (remove it, and the next reference writes it anew)"
)


class Known(NamedTuple):
    """What is known of a bubble: dots (H, W) as `pattern` gives them, name of its optical frame, intrinsics (3, 3)."""

    pattern: Image
    frame_id: str
    K: Array


def save(path: Path, bubbles: Mapping[str, Known]) -> None:
    """Write what is known of each finger, as npz, whole or not at all. Raises SeedError: it cannot be written."""
    arrays = {f"{f}_{name}": np.asarray(v) for f, known in bubbles.items() for name, v in known._asdict().items()}
    try:
        write_npz(path, arrays)
    except OSError as error:
        raise SeedError(f"identity_file {path} cannot be written: {error}") from error


def load(path: Path) -> dict[str, Known]:
    """Known bubbles by finger, as `save` has written them. Raises SeedError."""
    out: dict[str, Known] = {}
    data = read_npz(path, FOREIGN, MAX_BYTES)
    try:
        for f in FINGERS:
            if f"{f}_pattern" in data:
                dots, K = np.asarray(data[f"{f}_pattern"], np.float32), np.asarray(data[f"{f}_K"], float)
                if dots.ndim != 2 or K.shape != (3, 3) or not (np.isfinite(dots).all() and np.isfinite(K).all()):
                    raise ValueError(f"{f}: pattern of shape {dots.shape}, K of shape {K.shape}, or not finite")
                out[f] = Known(dots, str(data[f"{f}_frame_id"]), K)
    except (KeyError, TypeError, ValueError) as error:
        raise SeedError(f"{path}: {FOREIGN}: {error}") from error
    return out


def misnamed(finger: str, frame_id: str, names: Mapping[str, str]) -> str:
    """Why an image with this frame_id is not the finger's, or ''; names: frame_ids by finger."""
    for other, name in names.items():
        if other != finger and frame_id == name != names.get(finger):
            return f"{finger} image has frame_id '{frame_id}', the {other} camera's: left and right are swapped"
    return ""


def other_lens(finger: str, K: Array, known: Mapping[str, Known]) -> str:
    """Why a camera with intrinsics K (3, 3) is not the finger's, or '' when nothing says so."""
    if finger in known and np.abs(K - known[finger].K).max() < SAME_LENS:
        return ""
    for other, bubble in known.items():
        if other != finger and np.abs(K - bubble.K).max() < SAME_LENS:
            return f"camera_info of the {finger} finger has the {other} camera's intrinsics: left and right are swapped"
    return ""


def pattern(ir: Image) -> Image:
    """The dots of an infrared image (H, W), normalised and blurred."""
    return np.asarray(cv2.GaussianBlur(normalised(ir), (0, 0), BLUR), np.float32)


def correlation(a: Image, b: Image) -> float:
    """Of two patterns of one size, -1 to 1; the best quarter of the tiles counts, for contact moves the rest."""
    if a.shape != b.shape:
        return 0.0
    side = max(8, min(a.shape) // 6)
    scores = []
    for v in range(0, a.shape[0] - side + 1, side):
        for u in range(0, a.shape[1] - side + 1, side):
            x, y = a[v : v + side, u : u + side], b[v : v + side, u : u + side]
            scores.append(float(np.sum(x * y)) / (float(np.sqrt(np.sum(x * x) * np.sum(y * y))) + 1e-6))
    scores.sort()
    return float(np.mean(scores[-max(1, len(scores) // 4) :]))


def mistaken(finger: str, ir: Image, known: Mapping[str, Image]) -> str:
    """Why an image is not the finger's own upright one, or '' when nothing says so; known: saved patterns by finger."""
    if finger not in known:
        return ""
    seen = pattern(ir)
    own = correlation(seen, known[finger])
    if own >= SAME + MARGIN:
        return ""
    turned = correlation(np.ascontiguousarray(seen[::-1, ::-1]), known[finger])
    if turned > max(SAME, own + MARGIN):
        return (
            f"{finger} image is rotated by 180 degrees against the saved dot pattern: check how the camera is mounted"
        )
    for other, image in known.items():
        if other != finger and correlation(seen, image) > max(SAME, own + MARGIN):
            return f"{finger} image shows the {other} bubble's dots: left and right are swapped"
    return ""


class KnownBubbles:
    """Tells the bubbles apart, from one session to the next.

    Attributes:
        known: what was written, by an earlier session or the first reference of this one, by finger.
        names: frame_id that each finger's images should have.
        status: how the bubbles of the present reference were told apart, in words.
    """

    UNVERIFIED = "unverified"

    def __init__(self, file: str, names: Mapping[str, str]) -> None:
        """file: where it is remembered, '' for nowhere. Raises SeedError when it cannot be read."""
        self._path = Path(file) if file else None
        self.known = load(self._path) if self._path and self._path.exists() else {}
        self.names = {f: self.known[f].frame_id if f in self.known else name for f, name in names.items()}
        self.status = self.UNVERIFIED

    def judge(self, seen: Mapping[str, Known]) -> None:
        """Sets `status` from a new reference, and remembers the fingers of which nothing is known yet.

        Beside fingers that are known, another is remembered only where their dots are found again and are not its own.
        """
        known = self.known
        same = [f in known and correlation(b.pattern, known[f].pattern) >= SAME + MARGIN for f, b in seen.items()]
        named = [b.frame_id == self.names[f] for f, b in seen.items()]
        self.status = self.UNVERIFIED
        if all(same):
            self.status = "verified by dots"
        elif all(named) and len(set(self.names.values())) == len(self.names):
            self.status = "left and right verified by frame_id; orientation not verified (see identity_file)"
        new = {f: b for f, b in seen.items() if f not in known}
        found_again = all(alike for f, alike in zip(seen, same, strict=True) if f in known)
        others = [correlation(b.pattern, k.pattern) for b in new.values() for k in known.values()]
        if self._path and new and found_again and max(others, default=-1.0) < SAME + MARGIN:
            self.known = {**known, **new}
            save(self._path, self.known)
