# SPDX-License-Identifier: Apache-2.0
"""The clauses of the contract of a camera (docs/camera_contract.md): each looks at what was observed."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from seed_core.hand import FINGERS
from seed_core.spatial import Array
from seed_estimation.calibration.capture import LEAST_COVERAGE, MOST_FULL
from seed_estimation.contact.membrane import mean_depth
from seed_estimation.images import identity
from seed_testing.camera_observation import Observation, Stream

GAP = 1.5  # periods between two stamps: an image is missing
CONTINUOUS = 2e-6  # [m] depth in smaller steps has none
EIGHT_BITS = ("mono8", "8UC1", "rgb8", "bgr8", "rgba8", "bgra8")
SAME_LENS = 0.05  # [px] intrinsics that differ by less tell no camera from another


class Limits(NamedTuple):
    """What cameras are held to; the defaults are those of the suite."""

    rate: float = 20.0  # [Hz] at least
    missing: float = 0.01  # share of images that may be missing
    age: float = 0.15  # [s] from exposure to arrival at most, median
    ahead: float = 0.002  # [s] that a stamp may be in the future
    one_moment: float = 0.005  # [s] between depth and brightness
    fingers: float = 0.025  # [s] between left and right
    depth_step: float = 0.00101  # [m] at most
    near: float = 0.03  # [m] where a membrane may be
    far: float = 0.15  # [m]
    full: float = 65535.0  # [counts] of a full pixel of 16 bits; 255 of one of 8
    frames: tuple[str, str] = ("bubble_left_optical", "bubble_right_optical")
    known: Mapping[str, identity.Known] = {}  # what an identity_file says, by finger


Found = tuple[bool | None, str]  # whether a clause is kept (None: nothing here tells), and what was measured
Clause = Callable[[Observation, Limits], Found]


def images_come_often_and_whole(seen: Observation, limits: Limits) -> Found:
    """Every stream at its rate, without gaps."""
    out, good = [], True
    for name, stream in _named(seen):
        stamps = _stamps(stream)
        if len(stamps) < 3:
            good = False
            out.append(f"{name}: {len(stamps)} images on {stream.topic}")
            continue
        steps = np.diff(np.sort(stamps))
        period = float(np.median(steps))
        lost = int(np.sum(np.rint(steps[steps > GAP * period] / max(period, 1e-9)) - 1.0))
        rate = 1.0 / max(period, 1e-9)
        good &= rate >= limits.rate and lost <= limits.missing * len(stamps)
        out.append(f"{name} {rate:.1f} Hz, {lost} of {len(stamps) + lost} missing")
    return good, "; ".join(out)


def stamps_increase(seen: Observation, limits: Limits) -> Found:  # noqa: ARG001
    """No stamp twice, none backwards, none zero."""
    wrong = {n: sum(b <= a for a, b in pairwise(_stamps(s))) + sum(_stamps(s) <= 0.0) for n, s in _named(seen)}
    return not any(wrong.values()), "; ".join(f"{n}: {k} do not" for n, k in wrong.items() if k) or "all"


def stamps_are_of_the_exposure(seen: Observation, limits: Limits) -> Found:
    """Not in the future, and not old."""
    ages = {n: np.array([i.arrival - i.stamp for i in s.seen]) for n, s in _named(seen) if s.seen}
    if not ages:
        return False, "no images"
    good = all(np.median(a) <= limits.age and a.min() >= -limits.ahead for a in ages.values())
    every = np.concatenate(list(ages.values()))
    p5, p50, p95 = 1e3 * np.percentile(every, (5.0, 50.0, 95.0))
    words = f"age on arrival {p50:.1f} ms, 5 to 95 %: {p5:.1f} to {p95:.1f} ms"
    if every.min() >= 0.0 and p50 < 1.0:
        words += "; so young are stamps of the arrival, not of the exposure"
    return bool(good), words


def depth_and_brightness_are_of_one_moment(seen: Observation, limits: Limits) -> Found:
    """Each depth image has a picture of its time."""
    return _paired({f: (seen.streams[f, "depth"], seen.streams[f, "ir"]) for f in seen.fingers}, limits.one_moment)


def left_and_right_are_of_one_moment(seen: Observation, limits: Limits) -> Found:
    """The fingers' images can be used together."""
    if len(seen.fingers) < 2:
        return None, "one finger"
    return _paired({"both": (seen.streams["left", "depth"], seen.streams["right", "depth"])}, limits.fingers)


def encodings_can_be_read(seen: Observation, limits: Limits) -> Found:
    """Depth as numbers, brightness as counts; in which steps depth comes."""
    out, good = [], True
    for name, stream in _named(seen):
        codes = sorted({i.encoding for i in stream.seen})
        good &= not stream.problem and len(codes) == 1
        words = f"{name} {', '.join(codes) or 'nothing'}"
        if stream.kind == "depth" and stream.pixels:
            step = depth_step(stream)
            good &= step <= limits.depth_step
            words += f" in steps of {1e3 * step:.2g} mm" if step > CONTINUOUS else " without steps"
        out.append(stream.problem or words)
    return good, "; ".join(out)


def depth_step(stream: Stream) -> float:
    """The step in which depth comes [m]; 0 where it has none."""
    if stream.seen[-1].encoding != "32FC1":
        return 1e-3
    values = np.unique(np.rint(1e6 * stream.pixels[-1][np.isfinite(stream.pixels[-1])].astype(float)))
    return float(1e-6 * np.diff(values).min()) if len(values) > 1 else 0.0


def calibration_fits_the_images(seen: Observation, limits: Limits) -> Found:  # noqa: ARG001
    """camera_info comes, is possible, and is of the size of both images."""
    out, good = [], True
    for finger in seen.fingers:
        problem = seen.camera_problems[finger]
        camera = seen.cameras.get(finger)
        sizes = {(i.width, i.height) for k in ("depth", "ir") for i in seen.streams[finger, k].seen}
        if camera is not None and not problem and sizes != {(camera.width, camera.height)}:
            problem = f"images of {sorted(sizes)}, calibration of {camera.width} x {camera.height}"
        good &= not problem and camera is not None
        if camera is not None and not problem:
            problem = f"{camera.width} x {camera.height}, f {camera.K[0, 0]:.1f} px, {camera.model}"
        out.append(f"{finger}: {problem}")
    return good, "; ".join(out)


def membranes_are_in_view(seen: Observation, limits: Limits) -> Found:
    """Depth where a membrane is, with how much noise."""
    out, good = [], True
    for finger in seen.fingers:
        frames = seen.streams[finger, "depth"].pixels
        if len({f.shape for f in frames}) != 1 or len(frames) < 2:
            return False, f"{finger}: too few depth images of one size"
        mean, deviation = mean_depth(frames, limits.near, limits.far)
        there = np.isfinite(mean)
        share = float(there.mean())
        good &= share >= LEAST_COVERAGE
        noise = 1e3 * float(np.median(deviation[there])) if there.any() else 0.0
        out.append(
            f"{finger}: {share:.0%} of the image within {limits.near:g} and {limits.far:g} m, noise {noise:.2f} mm"
        )
    return good, "; ".join(out)


def pictures_are_exposed_well(seen: Observation, limits: Limits) -> Found:
    """Neither black nor full."""
    out, good = [], True
    for finger in seen.fingers:
        stream = seen.streams[finger, "ir"]
        if not stream.pixels:
            return False, f"{finger}: no picture"
        full = 255.0 if stream.seen[-1].encoding in EIGHT_BITS else limits.full
        picture = stream.pixels[-1]
        share, middle = float(np.mean(picture >= full)), float(np.median(picture))
        good &= share <= MOST_FULL and middle > 0.0
        out.append(f"{finger}: median {middle:.0f} of {full:.0f} counts, {share:.1%} full")
    return good, "; ".join(out)


def images_are_alive(seen: Observation, limits: Limits) -> Found:  # noqa: ARG001
    """No two images in a row are the same to the last bit."""
    frozen = []
    for name, stream in _named(seen):
        same = sum(np.array_equal(a, b, equal_nan=True) for a, b in pairwise(stream.pixels))
        if same:
            frozen.append(f"{name}: {same} of {len(stream.pixels) - 1} as the one before")
    return not frozen, "; ".join(frozen) or "all differ"


def left_is_left(seen: Observation, limits: Limits) -> Found:
    """The fingers can be told apart, and are not swapped."""
    if len(seen.fingers) < 2:
        return None, "one finger"
    names = [{i.frame_id for k in ("depth", "ir") for i in seen.streams[f, k].seen} for f in FINGERS]
    if any(len(n) != 1 for n in names):
        return False, f"frame_id differs among images of one finger: {[sorted(n) for n in names]}"
    left, right = (next(iter(n)) for n in names)
    if (left, right) == limits.frames[::-1]:
        return False, f"left images are of '{left}', right ones of '{right}': swapped"
    mistaken = _mistaken(seen, limits, "swapped")
    if mistaken:
        return False, mistaken
    lens = _lenses_differ(seen)
    words = f"frame_id '{left}' and '{right}'; intrinsics {'differ' if lens else 'are the same'}"
    return left != right or lens, words


def which_way_is_up(seen: Observation, limits: Limits) -> Found:
    """No image is upside down, as far as the dots of an earlier session tell."""
    if not limits.known:
        return None, "needs --identity with the file that the estimator's identity_file has written"
    mistaken = _mistaken(seen, limits, "rotated")
    return not mistaken, mistaken or "as in the identity file"


def _mistaken(seen: Observation, limits: Limits, what: str) -> str:
    patterns = {f: known.pattern for f, known in limits.known.items()}
    for finger in seen.fingers:
        pixels = seen.streams[finger, "ir"].pixels
        words = identity.mistaken(finger, pixels[-1], patterns) if pixels else ""
        if what in words:
            return words
    return ""


def _lenses_differ(seen: Observation) -> bool:
    K: list[Array] = [seen.cameras[f].K for f in seen.fingers if f in seen.cameras]
    return len(K) == 2 and float(np.abs(K[0] - K[1]).max()) > SAME_LENS


def _named(seen: Observation) -> list[tuple[str, Stream]]:
    return [(f"{finger} {kind}", stream) for (finger, kind), stream in seen.streams.items()]


def _stamps(stream: Stream) -> Array:
    return np.array([i.stamp for i in stream.seen], dtype=float)


def _paired(pairs: Mapping[str, tuple[Stream, Stream]], most: float) -> Found:
    """Whether the images of one stream have a partner in the other; the first and last may have lost theirs."""
    out, good = [], True
    for name, (a, b) in pairs.items():
        one, other = _stamps(a), np.sort(_stamps(b))
        inner = one[(one >= other[0]) & (one <= other[-1])] if len(other) else one[:0]
        if len(inner) < 2:
            return False, f"{name}: too few images at one time"
        at = np.clip(np.searchsorted(other, inner), 1, len(other) - 1)
        apart = np.minimum(np.abs(other[at] - inner), np.abs(other[at - 1] - inner))
        share = float(np.mean(apart <= most))
        good &= share >= 0.99
        out.append(f"{name}: {share:.0%} within {1e3 * most:g} ms, median {1e3 * float(np.median(apart)):.1f} ms")
    return good, "; ".join(out)


CLAUSES: tuple[Clause, ...] = (
    images_come_often_and_whole,
    stamps_increase,
    stamps_are_of_the_exposure,
    depth_and_brightness_are_of_one_moment,
    left_and_right_are_of_one_moment,
    encodings_can_be_read,
    calibration_fits_the_images,
    membranes_are_in_view,
    pictures_are_exposed_well,
    images_are_alive,
    left_is_left,
    which_way_is_up,
)


def check(seen: Observation, limits: Limits) -> list[Any]:
    """(clause, kept, found) of every clause."""
    return [(clause.__name__.replace("_", " "), *clause(seen, limits)) for clause in CLAUSES]
