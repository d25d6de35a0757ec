# SPDX-License-Identifier: Apache-2.0
"""The cameras of both bubbles, looked after: opened when they are there, opened again when they were lost.

Opening takes a second, in which the other camera goes on: a thread of its own does it.
"""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from seed_core.errors import SeedError
from seed_core.hand import FINGERS_OF
from seed_estimation.realsense import RealSenseError, library
from seed_estimation.realsense.camera import Camera, Pictures
from seed_estimation.realsense.selection import assign, describe, listed
from seed_estimation.realsense.settings import RealSenseSettings

LOOK = 0.25  # [s] between two looks at what is there
FIRST = 3.0  # [s] that a camera may take to its first images
Find = Callable[[], Sequence[Any]]  # devices of the library that are connected


def connected() -> Sequence[Any]:
    """Cameras on USB that can be opened. Raises RealSenseError: they cannot be listed."""
    rs = library()
    try:
        devices = rs.context().query_devices()
    except RuntimeError as error:
        raise RealSenseError(f"cameras on USB cannot be listed: {error}") from error
    return opened(devices)


def opened(devices: Sequence[Any]) -> list[Any]:
    """The devices of a list of the library, which opens one when it is taken from the list.

    One that does not open is left out: it was unplugged meanwhile, or another program has claimed its USB interface,
    as with RSUSB in place of V4L2 (realsenseai/librealsense: rs2_create_device in src/rs.cpp; handle-libusb.h).
    """
    out = []
    for i in range(len(devices)):
        with suppress(RuntimeError):
            out.append(devices[i])
    return out


def recorded(files: Sequence[str]) -> Sequence[Any]:
    """Recordings as cameras. Raises RealSenseError."""
    context = library().context()
    try:
        return [context.load_device(file) for file in files]
    except RuntimeError as error:
        raise RealSenseError(f"recordings {', '.join(files)}: {error}") from error


class Cameras:
    """`start`, then `take` often; `close` at the end.

    Attributes:
        problems: why a finger has no images, by finger.
        events: what has happened since it was asked last, as (cause, words).
        reconnections: times that a camera was opened again, by finger.
    """

    def __init__(self, settings: RealSenseSettings, find: Find | None = None) -> None:
        """find: lists the devices that are there; by default the recordings, or what is on USB."""
        self.settings = settings
        files = [file for file in settings.recordings if file]
        self._find: Find = find or ((lambda: recorded(files)) if files else connected)
        self.fingers = FINGERS_OF[settings.fingers]
        self._serials = {f: str(getattr(settings, f)) for f in self.fingers}
        self._open: dict[str, Camera] = {}
        self._before = dict.fromkeys(self.fingers, (0, 0))  # images taken and lost of cameras that are closed
        self._mute = dict.fromkeys(self.fingers, 0)  # openings in a row without any image
        self._ever: set[str] = set()
        self.problems: dict[str, str] = dict.fromkeys(self.fingers, "not opened yet")
        self.events: deque[tuple[str, str]] = deque(maxlen=100)
        self.reconnections = dict.fromkeys(self.fingers, 0)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._look_after, name="cameras", daemon=True)

    def start(self) -> None:
        """Begin to look after the cameras."""
        self._thread.start()

    def close(self) -> None:
        """Close all."""
        self._end.set()
        if self._thread.ident is not None:
            self._thread.join()
        for camera in self._open.values():
            camera.close()

    def camera(self, finger: str) -> Camera | None:
        """The camera of a finger, while it is open."""
        return self._open.get(finger)

    def take(self, use: Callable[[str, Camera, Pictures], None]) -> None:
        """Give the images that have come to `use`, with their finger and the camera that took them."""
        for finger, camera in tuple(self._open.items()):
            camera.take(partial(use, finger, camera))

    def counts(self, finger: str) -> tuple[int, int]:
        """Pairs of images taken and lost, of all cameras that the finger has had."""
        camera, (taken, lost) = self._open.get(finger), self._before[finger]
        return (taken + camera.taken, lost + camera.lost) if camera else (taken, lost)

    def _look_after(self) -> None:
        while not self._end.is_set():
            self.look()
            self._end.wait(LOOK)

    def look(self) -> None:
        """Close what is silent, and open what is missing."""
        for finger, camera in tuple(self._open.items()):
            if camera.silent_for > (self.settings.silence if camera.taken else FIRST):
                self._drop(finger, camera)
        missing = [f for f in self.fingers if f not in self._open]
        if not missing:
            return
        try:
            devices = {}
            for device in self._find():
                with suppress(RealSenseError):  # unplugged since it was listed: as if it were not there
                    devices[describe(device)] = device
            self._serials = assign(tuple(devices), self._serials)  # stays: one that returns is the same finger's
        except SeedError as error:
            for finger in missing:
                self._tell(finger, str(error))
            return
        by_serial = {found.serial: device for found, device in devices.items()}
        for finger in missing:
            serial = self._serials[finger]
            if serial in by_serial:
                self._try(finger, by_serial[serial])
            else:
                self._tell(finger, f"{finger}: camera {serial} is not there; {listed(tuple(devices))}")

    def _try(self, finger: str, device: Any) -> None:
        try:
            camera = Camera(finger, device, self.settings)
        except SeedError as error:
            self._tell(finger, str(error))
            return
        self._open = {**self._open, finger: camera}
        self.problems[finger] = ""
        again = finger in self._ever
        self.reconnections[finger] += again
        self._ever.add(finger)
        if camera.doubts:
            self.events.append(("camera_doubtful", f"{finger}: camera {camera.found}: {camera.doubts}"))

    def _drop(self, finger: str, camera: Camera) -> None:
        """Close a silent camera; one that stays silent through two openings is reset."""
        self._open = {f: c for f, c in self._open.items() if f != finger}
        self._mute[finger] = 0 if camera.taken else self._mute[finger] + 1
        taken, lost = self._before[finger]
        self._before[finger] = taken + camera.taken, lost + camera.lost
        camera.close()
        self._tell(
            finger,
            f"{finger}: camera {camera.found} has sent nothing for {camera.silent_for:.1f} s: was it unplugged? "
            "It is opened again as soon as it is there",
        )
        if self._mute[finger] >= 2:
            self._mute[finger] = 0
            camera.reset()

    def _tell(self, finger: str, words: str) -> None:
        if self.problems[finger] != words:
            self.problems[finger] = words
            self.events.append(("camera_missing", words))
