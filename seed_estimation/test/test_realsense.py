# SPDX-License-Identifier: Apache-2.0
"""D405 cameras, on the library's own software devices and recordings."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.config import ConfigError
from seed_core.errors import SeedError
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.realsense import RealSenseError, library
from seed_estimation.realsense.camera import Camera, Pictures
from seed_estimation.realsense.cameras import Cameras, opened
from seed_estimation.realsense.dating import Dating
from seed_estimation.realsense.selection import Found, assign, doubts
from seed_estimation.realsense.settings import RealSenseSettings

SMALL = RealSenseSettings(width=64, height=64, rate=30, silence=0.3)
LENS = PinholeCamera(64, 64, np.array(((60.0, 0.0, 32.0), (0.0, 60.0, 31.0), (0.0, 0.0, 1.0))))


def missing() -> str:
    try:
        library()
    except SeedError as error:
        return str(error)
    return ""


needs_library = pytest.mark.skipif(bool(missing()), reason=missing())


def software(serial: str, **how: Any) -> Any:
    from seed_estimation.realsense.software import SoftwareCamera

    return SoftwareCamera(serial, LENS, **how)


def dome(height: float = 0.08) -> Any:
    v, u = np.mgrid[:64, :64]
    return height + 1e-5 * ((u - 32) ** 2 + (v - 31) ** 2)


def until(true: Callable[[], bool], do: Callable[[], None], patience: float = 8.0) -> None:
    end = time.monotonic() + patience
    while not true():
        assert time.monotonic() < end
        do()
        time.sleep(0.01)


@pytest.fixture
def pair() -> Iterator[tuple[list[Any], list[Any], Cameras]]:
    shelf = [software("200"), software("100")]
    there = list(shelf)
    cameras = Cameras(SMALL, lambda: [s.device for s in there])
    yield shelf, there, cameras
    cameras.close()


@needs_library
def test_depth_keeps_its_tenth_of_a_millimetre_and_has_no_value_where_the_camera_has_none() -> None:
    source, got = software("1"), list[Pictures]()
    camera = Camera("left", source.device, SMALL)
    depth = np.round(dome(), 4)
    depth[3, 5] = np.nan
    t = time.time()
    source.show(depth, np.full((64, 64), 77), t, metadata={"actual_exposure": 8000})
    until(lambda: bool(got), lambda: camera.take(got.append))
    assert_allclose(got[0].depth, depth, atol=1e-8)
    assert got[0].depth.dtype == np.float32
    assert np.all(got[0].gray == 77)
    assert_allclose(got[0].stamp, t - 0.004, atol=1e-6)  # the middle of an exposure of 8 ms
    assert camera.model.matches(LENS)
    camera.close()


@needs_library
def test_the_moment_of_exposure_is_taken_from_the_camera_where_it_tells_it() -> None:
    source, got = software("1"), list[Pictures]()
    camera = Camera("left", source.device, SMALL)
    t = time.time()
    told = {"frame_timestamp": 5_010_000, "sensor_timestamp": 5_003_000, "actual_exposure": 2000}
    source.show(dome(), np.full((64, 64), 77), t, metadata=told)
    until(lambda: bool(got), lambda: camera.take(got.append))
    assert_allclose(got[0].stamp, t - 0.007, atol=1e-6)
    camera.close()


@needs_library
def test_images_that_did_not_come_are_counted_by_their_numbers() -> None:
    source, got = software("1"), list[Pictures]()
    camera = Camera("left", source.device, SMALL)
    for k in range(12):
        if k in (4, 5, 9):
            source.shown += 1  # exposed, and lost on the way
        else:
            source.show(dome(), np.full((64, 64), 77), time.time() + k / 30)
        camera.take(got.append)
    until(lambda: len(got) == 9, lambda: camera.take(got.append))
    assert (camera.taken, camera.lost) == (9, 3)
    camera.close()


@needs_library
def test_the_smaller_serial_is_left_and_stays_so_when_a_camera_is_unplugged_and_returns(pair: Any) -> None:
    shelf, there, cameras = pair
    seen: list[tuple[str, float]] = []

    def show() -> None:
        cameras.look()
        for one, height in zip(shelf, (0.09, 0.07), strict=True):
            if one in there:
                one.show(dome(height), np.full((64, 64), 77), time.time())
        cameras.take(lambda finger, _, pictures: seen.append((finger, float(np.nanmin(pictures.depth)))))

    until(lambda: len({f for f, _ in seen}) == 2, show)
    assert {f: round(v, 3) for f, v in seen} == {"left": 0.07, "right": 0.09}
    there.remove(shelf[1])  # that of the left bubble, serial 100
    until(lambda: "camera 100 is not there" in cameras.problems["left"], show)
    assert "200 (Intel RealSense D405, USB 3.2)" in cameras.problems["left"]
    assert cameras.problems["right"] == ""
    there.append(shelf[1])
    seen.clear()
    began = time.monotonic()
    until(lambda: any(f == "left" for f, _ in seen), show)
    assert time.monotonic() - began < 3.0
    assert {f: round(v, 3) for f, v in seen} == {"left": 0.07, "right": 0.09}
    assert cameras.reconnections == {"left": 1, "right": 0}


@needs_library
@pytest.mark.parametrize(
    ("how", "settings", "words"),
    [
        ({"told": {"name": "Intel RealSense D435"}}, SMALL, "is no D405.*parameter model"),
        ({"rate": 15, "told": {"usb_type_descriptor": "2.1"}}, SMALL, "on USB 2.1.*64 x 64 at 15 Hz.*USB 3 port"),
        ({"shift": 3.0}, SMALL, "differ by 3.0 px.*calibration"),
        ({}, RealSenseSettings(width=64, height=64, exposure=5000.0), "cannot be set: set exposure to 0"),
    ],
)
def test_a_camera_that_cannot_be_used_is_refused_with_what_to_do(how: Any, settings: Any, words: str) -> None:
    with pytest.raises(RealSenseError, match=words):
        Camera("left", software("1", **how).device, settings)


@needs_library
def test_a_camera_that_is_unplugged_while_it_is_listed_is_as_if_not_there_and_the_other_opens() -> None:
    """As the library does it: a device that is gone raises RuntimeError at the first question."""

    class Gone:
        def supports(self, _: Any) -> bool:
            raise RuntimeError("No such device")

    other = software("200")
    cameras = Cameras(RealSenseSettings(left="100", right="200", width=64, height=64), lambda: [Gone(), other.device])
    cameras.look()
    assert cameras.problems["right"] == ""
    assert "camera 100 is not there; connected: 200" in cameras.problems["left"]
    with pytest.raises(RealSenseError, match="unplugged just now"):
        Camera("left", Gone(), SMALL)
    cameras.close()


def test_a_camera_that_another_program_holds_does_not_hide_the_others() -> None:
    """The library opens a device when it is taken from its list, and raises RuntimeError where that fails."""

    class Listed(list[str]):
        def __getitem__(self, i: Any) -> Any:
            if i == 0:
                raise RuntimeError("failed to set power state")
            return super().__getitem__(i)

    assert opened(Listed(("held", "free"))) == ["free"]


@needs_library
def test_a_serial_that_is_not_there_is_told_with_those_that_are() -> None:
    one = software("555")
    cameras = Cameras(RealSenseSettings(left="1", right="2"), lambda: [one.device])
    cameras.look()
    assert "left: camera 1 is not there; connected: 555" in cameras.problems["left"]


@needs_library
def test_images_come_with_the_camera_that_took_them_even_if_it_is_given_up_meanwhile(pair: Any) -> None:
    shelf, _, cameras = pair
    came: list[tuple[str, str, bool]] = []

    def use(finger: str, camera: Camera, _: Pictures) -> None:
        cameras._drop(finger, camera)  # as the thread that looks after them does
        came.append((finger, camera.found.serial, cameras.camera(finger) is None))

    def show() -> None:
        cameras.look()
        for one in shelf:
            one.show(dome(), np.full((64, 64), 77), time.time())
        cameras.take(use)

    until(lambda: len({f for f, _, _ in came}) == 2, show)
    assert set(came) == {("left", "100", True), ("right", "200", True)}


@needs_library
def test_a_recording_is_played_as_a_camera_and_dated_by_its_arrival(tmp_path: Path) -> None:
    rs, source, file = library(), software("77"), tmp_path / "press.db3"
    recorder = rs.recorder(str(file), source.device)
    sensor = source._sensor
    sensor.open(sensor.get_stream_profiles())
    sensor.start(rs.frame_queue(4))
    for k in range(12):
        source.show(dome(), np.full((64, 64), 50 + k), 1000.0 + k / 30)
    sensor.stop()
    sensor.close()
    recorder.pause()
    del recorder
    cameras = Cameras(RealSenseSettings(fingers="left", recordings=[str(file)], width=64, height=64))
    got: list[Pictures] = []
    until(lambda: len(got) >= 3, lambda: (cameras.look(), cameras.take(lambda _f, _c, p: got.append(p)))[0])
    assert abs(got[-1].stamp - time.time()) < 2.0  # its own dates are of another year
    assert_allclose(np.nanmin(got[0].depth), 0.08, atol=1e-6)
    cameras.close()


def test_order_decides_only_when_nothing_is_missing() -> None:
    a, b, c = (Found(s, "D405", "5", "5", "3.2") for s in "abc")
    assert assign((b, a), {"left": "", "right": ""}) == {"left": "a", "right": "b"}
    assert assign((b, a), {"left": "b", "right": ""}) == {"left": "b", "right": "a"}
    for found in ((a,), (a, b, c), ()):
        with pytest.raises(RealSenseError, match=r"set the parameters left and right"):
            assign(found, {"left": "", "right": ""})
    with pytest.raises(ConfigError, match="one camera cannot look into both"):
        RealSenseSettings(left="7", right="7")


def test_old_firmware_and_usb_2_are_told() -> None:
    words = doubts(Found("1", "D405", "5.12.9", "5.16.0.1", "2.1"))
    assert "5.12.9 is older than 5.16.0.1" in words
    assert "rs-fw-update" in words
    assert "USB 2.1" in words
    assert doubts(Found("1", "D405", "5.16.0.1", "5.16.0.1", "3.2")) == ""
    assert doubts(Found("1", "D405", "5.12.9", "unknown", "3.2")) == ""  # the library names no firmware from 2.58.1 on


def test_a_clock_of_the_camera_is_fitted_to_the_soonest_arrival() -> None:
    dating, rng = Dating(), np.random.default_rng(3)
    began = 1.7e9
    for k in range(200):
        true = k / 30
        way = 0.012 + 0.01 * rng.exponential()  # [s] to this computer
        stamp = dating.date(5.0 + true, "hardware_clock", 0.003, began + true + way)
    assert_allclose(stamp, began + true + 0.012 - 0.003, atol=1e-3)
    stamp = dating.date(2.0, "hardware_clock", 0.003, began + 100.0)  # powered anew
    assert_allclose(stamp, began + 100.0 - 0.003, atol=1e-6)
    assert dating.clock == "hardware_clock, dated by arrival"


def test_a_fitted_clock_counts_unless_it_says_nonsense() -> None:
    dating = Dating()
    assert_allclose(dating.date(100.0, "global_time", 0.002, 100.02), 99.998)
    assert dating.clock == "global_time"
    assert_allclose(dating.date(1.0, "global_time", 0.002, 100.05), 100.048)  # not fitted yet
    assert "dated by arrival" in dating.clock


@needs_library
def test_a_pause_of_this_computer_is_no_silence_of_the_camera() -> None:
    camera = Camera("left", software("1").device, SMALL)
    camera.take(lambda _: None)
    time.sleep(0.3)  # no turn of the loop meanwhile
    camera.take(lambda _: None)
    assert camera.silent_for <= 0.11
    for _ in range(8):
        time.sleep(0.05)
        camera.take(lambda _: None)
    assert camera.silent_for >= 0.3
    camera.close()
