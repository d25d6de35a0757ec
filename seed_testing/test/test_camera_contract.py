# SPDX-License-Identifier: Apache-2.0
"""The contract of a camera: good cameras keep every clause, and each fault breaks the clause that speaks of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from rclpy.serialization import serialize_message

from seed_bringup.bags.files import BagWriter
from seed_core.hand import Hand
from seed_estimation import TactileImages
from seed_estimation.images import identity
from seed_ros.images import Intrinsics, camera_info, image_message
from seed_sim.tactile import TactileParameters, TactileRenderer
from seed_testing import camera_contract
from seed_testing.camera_clauses import Limits, check
from seed_testing.camera_observation import Observation

N, PERIOD, WAY = 24, 0.04, 0.02  # images, [s] between two, [s] on their way
BEGAN = 1000.0  # [s]
BUBBLES = TactileRenderer(TactileParameters(), Hand(), 3)
DRAWN = [BUBBLES.no_contact(k * PERIOD) for k in range(N)]


class Fault:
    """How a camera errs; this one does not."""

    def images(self, k: int, finger: str) -> TactileImages:
        return DRAWN[k][finger]

    def stamp(self, k: int, finger: str, kind: str) -> float:  # noqa: ARG002
        return BEGAN + k * PERIOD

    def arrival(self, k: int) -> float:
        return BEGAN + k * PERIOD + WAY

    def skipped(self, k: int) -> bool:  # noqa: ARG002
        return False

    def encoded(self, depth: Any) -> tuple[Any, str]:
        return depth, "32FC1"

    def frame_id(self, finger: str) -> str:
        return f"bubble_{finger}_optical"

    def intrinsics(self, finger: str) -> Intrinsics:
        c = BUBBLES.cameras[finger]
        return Intrinsics(c.width, c.height, list(c.K.ravel()), list(c.D), c.model)


def observed(fault: Fault) -> Observation:
    seen = Observation({"left": "bubble_left", "right": "bubble_right"})
    for finger in seen.fingers:
        seen.take_info(finger, camera_info(fault.intrinsics(finger), BEGAN, fault.frame_id(finger)))
        for k in (k for k in range(N) if not fault.skipped(k)):
            images, frame_id = fault.images(k, finger), fault.frame_id(finger)
            depth, encoding = fault.encoded(images.depth)
            for kind, data, code in (("depth", depth, encoding), ("ir", images.ir.astype(np.uint16), "mono16")):
                message = image_message(data, code, fault.stamp(k, finger, kind), frame_id)
                seen.streams[finger, kind].take(serialize_message(message), fault.arrival(k))
    return seen


def broken(fault: Fault, limits: Limits | None = None) -> dict[str, str]:
    return {clause: found for clause, kept, found in check(observed(fault), limits or Limits()) if kept is False}


def test_images_that_came_before_the_observation_and_then_stopped_are_no_images() -> None:
    seen = observed(Fault())
    for stream in seen.streams.values():
        stream.clear()  # as `listen` does when its time begins
    kept = {clause: good for clause, good, _ in check(seen, Limits())}
    assert kept["images come often and whole"] is False
    assert kept["pictures are exposed well"] is False


def test_good_cameras_break_nothing_and_only_the_way_up_stays_open() -> None:
    verdicts = check(observed(Fault()), Limits())
    assert [clause for clause, kept, _ in verdicts if kept is not True] == ["which way is up"]
    assert "25.0 Hz, 0 of 24 missing" in verdicts[0][2]
    assert "20.0 ms" in verdicts[2][2]


def test_a_full_pixel_of_a_colour_image_has_eight_bits() -> None:
    seen = observed(Fault())
    for stream in (seen.streams[f, "ir"] for f in seen.fingers):
        stream.pixels.append(np.full_like(stream.pixels[-1], 255.0))
        stream.seen[-1] = stream.seen[-1]._replace(encoding="bgra8")
    assert {clause: kept for clause, kept, _ in check(seen, Limits())}["pictures are exposed well"] is False


def fault(**how: Callable[..., Any]) -> Fault:
    return type("Erring", (Fault,), {name: staticmethod(what) for name, what in how.items()})()


def with_depth(change: Callable[[Any], Any]) -> Callable[[int, str], TactileImages]:
    def images(k: int, finger: str) -> TactileImages:
        i = DRAWN[k][finger]
        return TactileImages(change(i.depth).astype(np.float32), i.ir, i.stamp)

    return images


def with_picture(change: Callable[[Any], Any]) -> Callable[[int, str], TactileImages]:
    return lambda k, f: TactileImages(DRAWN[k][f].depth, change(DRAWN[k][f].ir), 0.0)


def of_another_size(finger: str) -> Intrinsics:
    return (
        Intrinsics(320, 240, [200.0, 0.0, 160.0, 0.0, 200.0, 120.0, 0.0, 0.0, 1.0], [0.0] * 5, "plumb_bob")
        if (finger == "left")
        else Fault().intrinsics(finger)
    )


@pytest.mark.parametrize(
    ("erring", "clause", "words"),
    [
        (fault(skipped=lambda k: k in (7, 8, 15)), "images come often and whole", "3 of 24 missing"),
        (fault(stamp=lambda *_: BEGAN), "stamps increase", "left depth: 23 do not"),
        (fault(arrival=lambda k: BEGAN + k * PERIOD - 0.1), "stamps are of the exposure", "-100.0 ms"),
        (fault(arrival=lambda k: BEGAN + k * PERIOD + 0.4), "stamps are of the exposure", "400.0 ms"),
        (
            fault(stamp=lambda k, _, kind: BEGAN + k * PERIOD + 0.011 * (kind == "ir")),
            "depth and brightness are of one moment",
            "0% within 5 ms",
        ),
        (
            fault(stamp=lambda k, f, _: BEGAN + k * PERIOD + 100.0 * (f == "left")),
            "left and right are of one moment",
            "too few images at one time",
        ),
        (
            fault(encoded=lambda d: (np.zeros((*d.shape, 3), np.uint8), "rgb8")),
            "encodings can be read",
            "switch the colorizer",
        ),
        (
            fault(encoded=lambda d: ((np.floor(250 * d) / 250).astype(np.float32), "32FC1")),
            "encodings can be read",
            "in steps of 4 mm",
        ),
        (fault(intrinsics=of_another_size), "calibration fits the images", "calibration of 320 x 240"),
        (fault(images=with_depth(lambda d: d + 0.3)), "membranes are in view", "0% of the image"),
        (fault(images=with_picture(lambda i: i * 0 + 65535)), "pictures are exposed well", "100.0% full"),
        (fault(images=lambda k, f: DRAWN[k // 8][f]), "images are alive", "as the one before"),
        (fault(frame_id=lambda f: f"bubble_{'right' if f == 'left' else 'left'}_optical"), "left is left", "swapped"),
        (fault(frame_id=lambda _: "camera"), "left is left", "intrinsics are the same"),
    ],
)
def test_each_fault_breaks_its_clause(erring: Fault, clause: str, words: str) -> None:
    found = broken(erring)
    assert words in found.get(clause, ""), found


def test_an_image_upside_down_is_told_by_the_dots_of_an_earlier_session() -> None:
    known = {
        f: identity.Known(identity.pattern(DRAWN[0][f].ir), f"bubble_{f}_optical", c.K)
        for f, c in BUBBLES.cameras.items()
    }
    limits = Limits(known=known)
    assert broken(Fault(), limits) == {}
    turned = fault(images=with_picture(lambda i: np.ascontiguousarray(i[::-1, ::-1])))
    assert "rotated by 180 degrees" in broken(turned, limits)["which way is up"]


@pytest.mark.parametrize("brightness", ["ir", "infra1"])  # the latter as realsense2_camera calls a D405's left imager
def test_a_bag_is_judged_by_its_times_of_recording(brightness: str, tmp_path: Path, capsys: Any) -> None:
    good, bag = Fault(), tmp_path / "bag"
    with BagWriter(bag) as writer:
        for finger in ("left", "right"):
            info = camera_info(good.intrinsics(finger), BEGAN, good.frame_id(finger))
            of_info = writer.add_topic(f"/bubble_{finger}/depth/camera_info", "sensor_msgs/msg/CameraInfo")
            writer.write(of_info, int(1e9 * BEGAN), serialize_message(info))
            for kind in ("depth", "ir"):
                topic = f"/bubble_{finger}/{'depth' if kind == 'depth' else brightness}/image_rect_raw"
                connection = writer.add_topic(topic, "sensor_msgs/msg/Image")
                for k in range(N):
                    i = DRAWN[k][finger]
                    data, code = (i.depth, "32FC1") if kind == "depth" else (i.ir.astype(np.uint16), "mono16")
                    message = image_message(data, code, BEGAN + k * PERIOD, good.frame_id(finger))
                    writer.write(connection, int(1e9 * good.arrival(k)), serialize_message(message))
    options = ["--bag", str(bag), "--brightness", brightness]
    assert camera_contract.main(options) == 0
    assert "age on arrival 20.0 ms" in capsys.readouterr().out
    assert camera_contract.main([*options, "--left", "/other"]) == 1
    assert "BROKEN" in capsys.readouterr().out
