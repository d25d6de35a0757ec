# SPDX-License-Identifier: Apache-2.0
"""One camera that streams: depth and the left imager's brightness, which share their pixels and their exposure."""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_estimation.images.camera import PinholeCamera
from seed_estimation.realsense import RealSenseError, library
from seed_estimation.realsense.dating import Dating, since_exposure
from seed_estimation.realsense.selection import describe, doubts, unfit
from seed_estimation.realsense.settings import RealSenseSettings

QUEUE = 64  # frames that may wait: a second of both streams, so that a busy computer loses none
PAUSE = 0.05  # [s] a longer time between two calls of `take` is a pause of this computer, not a camera's silence
SAME_MOMENT = 0.25  # [periods] within which two frames are of one exposure
SAME_PIXELS = 0.5  # [px] by which the intrinsics of both images may differ


class Pictures(NamedTuple):
    """Images of one exposure.

    Attributes:
        depth: (H, W) [m], NaN where there is none.
        gray: (H, W) brightness, pixel for pixel on depth [counts of 255].
        stamp: middle of the exposure by this computer's clock [s].
        arrival: when they were there, by the same clock [s].
    """

    depth: NDArray[np.float32]
    gray: NDArray[np.uint8]
    stamp: float
    arrival: float


class Camera:
    """A camera from its opening to its end.

    Attributes:
        found: how it presents itself.
        doubts: what speaks against it, or ''.
        model: intrinsics of both images.
        depth_unit: [m] step of its depth.
        silent_for: time without a pair of images while somebody asked for them [s].
        taken, lost: pairs of images, and those that its numbers tell of but that did not come whole.
    """

    def __init__(self, finger: str, device: Any, settings: RealSenseSettings) -> None:
        """Open a device of the library and let it stream. Raises RealSenseError."""
        rs = library()
        self._device, self.found = device, describe(device)
        self.doubts = doubts(self.found)
        problem = unfit(self.found, settings.model)
        if problem:
            raise RealSenseError(f"{finger}: {problem}")
        self.finger, self.taken, self.lost, self.dating = finger, 0, 0, Dating()
        self._polled, self._number = time.monotonic(), -1
        self.silent_for = 0.0
        self._streaming = False
        self._waiting: dict[bool, Any] = {}  # the newest frame without partner; by whether it is depth
        self._tolerance = 1e3 * SAME_MOMENT / settings.rate  # [ms]
        try:
            sensors = [s for s in device.query_sensors() if s.is_depth_sensor()]
            if not sensors:
                raise RealSenseError(f"{finger}: camera {self.found} has no depth sensor: is it in recovery mode?")
            self._sensor = sensors[0]
            profiles = _profiles(rs, self._sensor, settings, self.found)
            self.model = _shared_intrinsics(rs, profiles, self.found)
            self._set_up(rs, settings)
            self._queue = rs.frame_queue(QUEUE, keep_frames=True)
            self._sensor.open(profiles)
            self._streaming = True
            self._sensor.start(self._queue)
        except RuntimeError as error:  # all that the library raises
            self.close()
            raise RealSenseError(
                f"{finger}: camera {self.found} does not open: {error}. Does another program use it?"
            ) from error

    def _set_up(self, rs: Any, settings: RealSenseSettings) -> None:
        """Options, before it streams. What a camera has not is left; what it refuses is an error."""
        option = rs.option
        self._set(option.global_time_enabled, 1.0)
        self._set(option.depth_units, settings.depth_unit)
        self.depth_unit = float(self._sensor.get_option(option.depth_units))
        self._set(option.enable_auto_exposure, float(settings.exposure == 0.0))
        if settings.exposure:
            if not self._sensor.supports(option.exposure):
                raise RealSenseError(
                    f"{self.finger}: the exposure of camera {self.found} cannot be set: set exposure to 0"
                )
            span = self._sensor.get_option_range(option.exposure)
            if not span.min <= settings.exposure <= span.max:
                raise RealSenseError(
                    f"{self.finger}: exposure = {settings.exposure:g} us; camera {self.found} takes {span.min:g} to "
                    f"{span.max:g} us"
                )
            self._set(option.exposure, settings.exposure)

    def _set(self, option: Any, value: float) -> None:
        if self._sensor.supports(option) and not self._sensor.is_option_read_only(option):
            self._sensor.set_option(option, value)

    def take(self, use: Callable[[Pictures], None]) -> None:
        """Give every pair of images that has come to `use`."""
        now = time.monotonic()
        self.silent_for += min(now - self._polled, PAUSE)
        self._polled = now
        while frame := self._queue.poll_for_frame():
            self._add(frame, use)

    def _add(self, frame: Any, use: Callable[[Pictures], None]) -> None:
        """Pair a frame with that of the other stream which was exposed at the same moment."""
        is_depth = bool(frame.is_depth_frame())
        other = self._waiting.get(not is_depth)
        if other is None or abs(other.get_timestamp() - frame.get_timestamp()) > self._tolerance:
            self._waiting[is_depth] = frame
            return
        self._waiting.clear()
        depth, gray = (frame, other) if is_depth else (other, frame)
        number = depth.get_frame_number()
        if self._number >= 0 and number > self._number:  # a camera that starts anew counts from the beginning
            self.lost += number - self._number - 1
        self._number = number
        self.taken += 1
        self.silent_for, arrival = 0.0, time.time()
        stamp = self.dating.date(
            1e-3 * depth.get_timestamp(), depth.get_frame_timestamp_domain().name, since_exposure(depth), arrival
        )
        raw = np.asanyarray(depth.get_data())
        metres = np.multiply(raw, np.float32(self.depth_unit), dtype=np.float32)
        np.copyto(metres, np.float32(np.nan), where=raw == 0)
        use(Pictures(metres, np.asanyarray(gray.get_data()), stamp, arrival))

    def close(self) -> None:
        """End the streams, also of a camera that is gone."""
        for end in (self._sensor.stop, self._sensor.close) if self._streaming else ():
            with suppress(RuntimeError):  # it is gone already
                end()

    def reset(self) -> None:
        """Have the camera start anew, as when it is plugged in."""
        with suppress(RuntimeError):  # not every device can
            self._device.hardware_reset()


def _profiles(rs: Any, sensor: Any, settings: RealSenseSettings, found: Any) -> list[Any]:
    """Depth and left infrared in the mode that is asked for."""
    kinds = {"depth": (rs.stream.depth, rs.format.z16), "infrared": (rs.stream.infrared, rs.format.y8)}
    modes: dict[str, dict[tuple[int, int, int], Any]] = {name: {} for name in kinds}
    for profile in sensor.get_stream_profiles():
        for name, kind in kinds.items():
            if (profile.stream_type(), profile.format()) == kind and profile.stream_index() in (0, 1):
                video = profile.as_video_stream_profile()
                modes[name].setdefault((video.width(), video.height(), video.fps()), profile)
    asked = settings.width, settings.height, settings.rate
    offered = sorted(set(modes["depth"]) & set(modes["infrared"]))
    if asked not in offered:
        choice = ", ".join("{} x {} at {} Hz".format(*mode) for mode in offered) or "none"
        port = f"on USB {found.usb}, " if found.slow_port else ""
        cure = "Use a USB 3 port and cable, or one of these modes" if found.slow_port else "Set width, height and rate"
        raise RealSenseError(
            f"camera {found}: {port}depth and infrared of {asked[0]} x {asked[1]} at {asked[2]} Hz are not offered; "
            f"offered: {choice}. {cure}"
        )
    return [modes[name][asked] for name in kinds]


def _shared_intrinsics(rs: Any, profiles: list[Any], found: Any) -> PinholeCamera:
    """Of both images, which must lie on each other pixel for pixel."""
    depth, gray = (p.as_video_stream_profile().get_intrinsics() for p in profiles)
    apart = max(abs(getattr(depth, name) - getattr(gray, name)) for name in ("fx", "fy", "ppx", "ppy"))
    if apart > SAME_PIXELS:
        raise RealSenseError(
            f"camera {found}: depth and infrared have intrinsics that differ by {apart:.1f} px, so that their pixels "
            "are not the same: is its calibration damaged (rs-enumerate-devices -c)?"
        )
    names = {rs.distortion.none: "plumb_bob", rs.distortion.brown_conrady: "plumb_bob"}
    names[rs.distortion.inverse_brown_conrady] = "inverse_brown_conrady"
    K = np.array(((depth.fx, 0.0, depth.ppx), (0.0, depth.fy, depth.ppy), (0.0, 0.0, 1.0)))
    if depth.model not in names and any(depth.coeffs):
        raise RealSenseError(f"camera {found}: distortion model '{depth.model}' is not known")
    return PinholeCamera(depth.width, depth.height, K, np.array(depth.coeffs), names.get(depth.model, "plumb_bob"))
