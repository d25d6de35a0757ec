# SPDX-License-Identifier: Apache-2.0
"""Which camera looks into which bubble, and what is wrong with one."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from seed_estimation.realsense import RealSenseError, library

UNKNOWN = "unknown"


class Found(NamedTuple):
    """A camera as it presents itself."""

    serial: str
    name: str
    firmware: str
    recommended: str  # firmware that the library asks for; none from 2.58.1 on (librealsense, pull request 15063)
    usb: str  # such as 3.2

    def __str__(self) -> str:
        return f"{self.serial} ({self.name}, USB {self.usb})"

    @property
    def slow_port(self) -> bool:
        """Whether it hangs on USB 2 or older."""
        return self.usb[:2] in ("1.", "2.")


def describe(device: Any) -> Found:
    """What a device of the library says of itself. Raises RealSenseError: nothing; it was unplugged meanwhile."""
    info = library().camera_info
    kinds = (
        info.serial_number,
        info.name,
        info.firmware_version,
        info.recommended_firmware_version,
        info.usb_type_descriptor,
    )
    try:
        return Found(*(str(device.get_info(kind)) if device.supports(kind) else UNKNOWN for kind in kinds))
    except RuntimeError as error:
        raise RealSenseError(
            f"a camera that was listed does not answer: {error}. Was it unplugged just now?"
        ) from error


def assign(found: Sequence[Found], wanted: Mapping[str, str]) -> dict[str, str]:
    """Serial number by finger; wanted: the same, '' where the order of serial numbers decides.

    Raises:
        RealSenseError: order cannot decide, as there are too many or too few cameras.
    """
    free = sorted({f.serial for f in found} - set(wanted.values()))
    open_fingers = [finger for finger, serial in wanted.items() if not serial]
    if open_fingers and len(free) != len(open_fingers):
        raise RealSenseError(
            f"no serial number is set for {' and '.join(open_fingers)}, and {listed(found)}: order decides among "
            f"{len(open_fingers)} only. Plug in what is missing, or set the parameters left and right to serial numbers"
        )
    return {**wanted, **dict(zip(open_fingers, free, strict=True))} if open_fingers else dict(wanted)


def listed(found: Sequence[Found]) -> str:
    """The cameras that are there, in words."""
    if not found:
        return "no RealSense camera is connected (USB cable? udev rules for access without root?)"
    return f"connected: {', '.join(map(str, found))}"


def unfit(camera: Found, model: str) -> str:
    """Why a camera cannot be used, or ''."""
    if model not in camera.name:
        return (
            f"camera {camera} is no {model}: others see nothing as near as a membrane (55 to 105 mm). "
            "Set the parameter model if yours does"
        )
    return ""


def doubts(camera: Found) -> str:
    """What speaks against a camera that is used nevertheless, or ''."""
    out = []
    if _version(camera.firmware) < _version(camera.recommended):
        out.append(
            f"firmware {camera.firmware} is older than {camera.recommended}, which the library is made for: update it "
            "with rs-fw-update -f FILE (librealsense's tools; files: dev.realsenseai.com/docs/firmware-updates)"
        )
    if camera.slow_port:
        out.append(f"it hangs on USB {camera.usb}: images may be lost; use a USB 3 port and cable")
    return "; ".join(out)


def _version(text: str) -> tuple[int, ...]:
    """Numbers of a version; of an unknown one none, which is not older than another unknown one."""
    return tuple(map(int, re.findall(r"\d+", text)))
