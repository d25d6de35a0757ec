# SPDX-License-Identifier: Apache-2.0
"""Cameras of the library's own software devices: what a D405 tells and sends, without one."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_estimation.images.camera import PinholeCamera
from seed_estimation.realsense import library

NAME = "Intel RealSense D405"
UNIT = 1e-4  # [m] of its depth


class SoftwareCamera:
    """A camera that shows what it is given.

    Attributes:
        device: of the library; `Cameras` finds it where `find` lists it.
        shown: images so far.
    """

    def __init__(
        self,
        serial: str,
        camera: PinholeCamera,
        told: Mapping[str, str] | None = None,
        rate: int = 30,
        shift: float = 0.0,
    ) -> None:
        """A camera that nobody has opened yet.

        Args:
            serial: number.
            camera: intrinsics of both images.
            told: what else it says of itself, by name in the library's camera_info.
            rate: [Hz] of the only mode that it offers.
            shift: of the infrared image's principal point [px], as of a camera whose calibration is damaged.
        """
        rs = library()
        self._rs, self.shown = rs, 0
        self.device = rs.software_device()
        usual = {"name": NAME, "firmware_version": "5.16.0.1", "usb_type_descriptor": "3.2"}
        for name, value in {**usual, **(told or {}), "serial_number": serial}.items():
            kind = getattr(rs.camera_info, name)
            if self.device.supports(kind):
                self.device.update_info(kind, value)
            else:
                self.device.register_info(kind, value)
        self._sensor = self.device.add_sensor("Stereo Module")
        self._sensor.add_read_only_option(rs.option.depth_units, UNIT)
        kinds = ((rs.stream.depth, rs.format.z16, 2, 0.0), (rs.stream.infrared, rs.format.y8, 1, shift))
        self._profiles = []
        for index, (stream, form, size, move) in enumerate(kinds):
            video = rs.video_stream()
            video.type, video.fmt, video.bpp, video.index, video.uid = stream, form, size, index, index
            video.width, video.height, video.fps = camera.width, camera.height, rate
            video.intrinsics = _intrinsics(rs, camera, move)
            self._profiles.append(self._sensor.add_video_stream(video).as_video_stream_profile())

    def show(
        self,
        depth: NDArray[np.floating],
        gray: NDArray[np.generic],
        t: float,
        metadata: Mapping[str, int] | None = None,
    ) -> None:
        """Send images of one exposure; nobody gets them while nobody has opened the camera.

        Args:
            depth: (H, W) [m], NaN where there is none.
            gray: (H, W) [counts of 255].
            t: [s] that the frames carry.
            metadata: of the frames, by name in the library's frame_metadata_value.
        """
        for name, value in (metadata or {}).items():
            self._sensor.set_metadata(getattr(self._rs.frame_metadata_value, name), value)
        steps = np.where(np.isfinite(depth), np.rint(depth / UNIT), 0.0).astype(np.uint16)
        self.show_raw(steps, gray.astype(np.uint8), t)

    def show_raw(self, depth: NDArray[np.uint16], gray: NDArray[np.uint8], t: float) -> None:
        """As `show`, with depth in steps of UNIT."""
        images: tuple[NDArray[Any], ...] = depth, gray
        for pixels, profile in zip(images, self._profiles, strict=True):
            frame = self._rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = pixels, pixels.itemsize, pixels.strides[0]
            frame.timestamp, frame.domain = 1e3 * t, self._rs.timestamp_domain.global_time
            frame.frame_number, frame.profile = self.shown, profile
            if profile.stream_type() == self._rs.stream.depth:
                frame.depth_units = UNIT
            with suppress(RuntimeError):  # nobody has opened it
                self._sensor.on_video_frame(frame)
        self.shown += 1


def _intrinsics(rs: Any, camera: PinholeCamera, shift: float) -> Any:
    out = rs.intrinsics()
    out.width, out.height = camera.width, camera.height
    out.fx, out.fy = camera.K[0, 0], camera.K[1, 1]
    out.ppx, out.ppy = camera.K[0, 2] + shift, camera.K[1, 2]
    out.model = rs.distortion.inverse_brown_conrady if camera.D.any() else rs.distortion.brown_conrady
    out.coeffs = [float(v) for v in camera.D]
    return out
